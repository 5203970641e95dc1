# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Features of a drive in the stand-in's equations: what a smooth correction is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.library.features import FEATURES, Signals
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.residuals import (
    COMMAND_GRID_S,
    STEP_S,
    ActiveTerms,
    ResidualProblem,
)
from adk_ros.mismatch.surrogate.state_index import A_X, A_Y, V_Y, YAW_RATE
from adk_ros.numerics.arrays import FloatArray

EQUATION_PARAMETERS = {"v_x": "extra_x", "v_y": "extra_y", "yaw_rate": "extra_yaw"}


@dataclass(frozen=True)
class FeatureTerm:
    """One feature in one equation: `coefficient` of the feature itself, SI; `gain` in loss."""

    equation: str
    feature: str
    coefficient: float
    gain: float


def feature_signals(course: ResidualProblem, out: FloatArray) -> Signals:
    """Return the drive's signals (n,) at the grid's steps, of a run's output."""
    at = course.start_s - course.command_start_s + STEP_S * np.arange(course.steps + 1)
    grid = COMMAND_GRID_S * np.arange(course.torques.shape[0])
    return {
        "v_x": course.smoothed_odometry[:, 0],
        "v_y": out[V_Y],
        "yaw_rate": out[YAW_RATE],
        "a_x": out[A_X],
        "a_y": out[A_Y],
        "torque": np.diff(np.interp(at, grid, course.torques)) / STEP_S,
        "delta": np.diff(np.interp(at, grid, course.angles)) / STEP_S,
    }


def active_terms_of(
    pieces: Sequence[FeatureTerm], course: ResidualProblem, out: FloatArray
) -> ActiveTerms:
    """Return what pieces add along a course, their features those of a run's output."""
    if not pieces:
        return course.no_terms()
    signals = feature_signals(course, out)
    rows = [FEATURES[piece.feature].function(signals) for piece in pieces]
    return ActiveTerms(
        np.array([INDEX[EQUATION_PARAMETERS[piece.equation]] for piece in pieces], dtype=np.int64),
        np.array([piece.coefficient for piece in pieces]),
        np.arange(1, len(pieces) + 1),
        np.vstack([np.ones(course.steps), *rows]),
    )
