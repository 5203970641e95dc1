# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of open-loop predictions that build tolerances of the car cause."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.mismatch.deployment.held_out import (
    HORIZONS_S,
    Evidence,
    horizon_errors,
    rmse,
)
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.inference.nuisances import TOLERANCE_PARAMETERS
from adk_ros.mismatch.library.criteria import TOLERANCE_SIGMA
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES


def tolerance_error(model: SurrogateFile, evidence: Sequence[Evidence]) -> FloatArray:
    """
    Return the RMSE (horizons, 3) of a model of which only the build tolerances are wrong.

    Each is moved by its prior standard deviation; they are independent, so that squares add up.
    """
    base = horizon_errors(model, evidence)
    square = np.zeros((len(HORIZONS_S), len(STATE_NAMES)))
    for name in TOLERANCE_PARAMETERS:
        moved = {**model.tolerances, name: model.tolerances.get(name, 0.0) + TOLERANCE_SIGMA}
        changed = horizon_errors(model.model_copy(update={"tolerances": moved}), evidence)
        square += np.nan_to_num(rmse(changed - base)) ** 2
    return np.asarray(np.sqrt(square))
