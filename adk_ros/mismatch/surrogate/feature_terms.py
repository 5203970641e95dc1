# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Feature terms: candidate functions of the signals added to the surrogate's accelerations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.library.features import Signals, feature
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.residuals import ResidualProblem
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.mismatch.surrogate.state_index import A_X, A_Y, V_Y, YAW_RATE
from adk_ros.numerics.arrays import FloatArray

STEERING = "steering"
EQUATION_PARAMETERS = {
    "v_x": "extra_x",
    "v_y": "extra_y",
    "yaw_rate": "extra_yaw",
    STEERING: "extra_steer",
}
"""
Equation -> entry of the parameter vector that adds to it: an acceleration, or a road-wheel angle,
which enters both lateral equations. The order is that of the columns of `RunInputs.extra`.
"""


@dataclass(frozen=True)
class FeatureTerm:
    """
    One feature in one equation.

    `coefficient` multiplies the feature, SI; `gain` is the decrease in loss that the term brings.
    """

    equation: str
    feature: str
    coefficient: float
    gain: float


def feature_signals(problem: ResidualProblem, out: FloatArray) -> Signals:
    """Return the signals (n,) at the steps of the grid; `out` is the output of a run."""
    torque, delta = problem.mean_commands()
    return {
        "time": problem.middle_s,
        "v_x": problem.smoothed_odometry[:, 0],
        "v_y": out[V_Y],
        "yaw_rate": out[YAW_RATE],
        "a_x": out[A_X],
        "a_y": out[A_Y],
        "torque": torque,
        "delta": delta,
    }


def active_terms_of(
    features: Sequence[FeatureTerm], problem: ResidualProblem, out: FloatArray
) -> ActiveTerms:
    """Return the feature terms along a recording; `out`, of an earlier run, gives the signals."""
    if not features:
        return problem.no_terms()
    signals = feature_signals(problem, out)
    rows = [feature(term.feature).function(signals) for term in features]
    entries = [INDEX[EQUATION_PARAMETERS[term.equation]] for term in features]
    return ActiveTerms(
        np.array(entries, dtype=np.int64),
        np.array([term.coefficient for term in features]),
        np.arange(1, len(features) + 1),
        np.vstack([np.ones(problem.steps), *rows]),
    )
