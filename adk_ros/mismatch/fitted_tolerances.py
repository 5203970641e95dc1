# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Held-out errors that build tolerances explain, as fitted to the training part.

Where nothing is named, the simulation itself is judged, and the error that a car within build
tolerance may cause is an average over such cars. An unusual car errs more. Its tolerances show in
the training part, and with them the model must predict the held-out part as well as noise and the
surrogate's own error allow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from adk_ros.mismatch.deployment.corrected_model import corrected_yaml
from adk_ros.mismatch.deployment.held_out import Evidence
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import NONE
from adk_ros.mismatch.library.criteria import FAMILYWISE_ERROR_RATE
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.mismatch.validation import Validation, model_errors
from adk_ros.numerics.arrays import FloatArray


def with_fitted_tolerances(
    validation: Validation,
    decision: Decision,
    surrogate: SurrogateModel,
    training: Likelihood,
    lap: Lap | None,
    held_out: Sequence[Evidence],
) -> Validation:
    """Return a validation that also judges a car without effects by its fitted tolerances."""
    h, errors = decision.hypothesis, validation.errors
    if decision.verdict != NONE or h.effects or errors.is_explained:
        return validation
    if not is_within_prior(h.nuisances, training.nuisance_deviations()):
        return validation
    fitted, expected = model_errors(surrogate, corrected_yaml(surrogate, h, lap), held_out)
    judged = replace(
        errors,
        corrected=np.where(np.isfinite(errors.corrected), fitted, np.nan),
        expected=expected,
        tolerances_fitted=True,
    )
    return replace(validation, errors=judged) if judged.is_explained else validation


def is_within_prior(nuisances: FloatArray, deviations: FloatArray) -> bool:
    """
    Whether fitted nuisances (k,) are those of a usual car.

    The sum of the squares of k standard normal variables exceeds the chi-square quantile once in
    20 times; that of fitted values, which the prior draws to zero, less often.
    """
    squares = float(np.sum((nuisances / deviations) ** 2))
    return squares <= float(chdtri(nuisances.size, FAMILYWISE_ERROR_RATE))
