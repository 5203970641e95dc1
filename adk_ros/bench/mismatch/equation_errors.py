# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a model leaves of a recording's accelerations: the same residuals for every method.

The model runs along with what was measured, held to it, so that each equation is looked at by
itself. Residual: d/dt of the measured v_x, v_y (odometry) and yaw rate (gyro, if there is one)
less the model's own, both as slopes of lines fitted over half a second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.inference.likelihood import ActiveEffect, Likelihood
from adk_ros.mismatch.inference.observability import with_pseudo_imu
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import PLACE, TIME
from adk_ros.mismatch.library.features import FEATURES, feature_matrix
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.feature_terms import feature_signals
from adk_ros.mismatch.surrogate.lap import Lap, find_lap
from adk_ros.mismatch.surrogate.residuals import (
    OBSERVER_GAINS,
    STEP_S,
    ActiveTerms,
    ResidualProblem,
    prepare_residual_problem,
)
from adk_ros.mismatch.surrogate.state_index import V_X, V_Y, YAW_RATE
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES

HALF = 25
"""Steps of the grid to either side of a slope's middle."""
EVERY = 4
"""Steps of the grid from one row to the next."""
_HELD = 10.0
_SETTLING_S = 1.5


@dataclass(frozen=True)
class EquationErrors:
    """
    Rows in time: `time_s` (n,), `features` (n, k) of `names`, `residuals` (n, 3) of v_x, v_y, r.

    `noise` (3,) is what the sensors' noise makes of a residual.
    """

    time_s: FloatArray
    names: tuple[str, ...]
    features: FloatArray
    residuals: FloatArray
    noise: FloatArray


def equation_errors(recording: SensorLog, model: SurrogateFile) -> EquationErrors:
    """Return what a stand-in, its terms and its correction leave of a recording."""
    e = with_pseudo_imu(recording)
    course = prepare_residual_problem(e)
    vector, terms = _setting(course, find_lap(course), model)
    out = course.run(vector, terms, _HELD)
    if model.correction:
        out = course.run(vector, terms, _HELD, _extra(model, course, out))
    own = np.column_stack([
        _changes(out[row], course.smoothed_odometry[:, i], min(OBSERVER_GAINS[i] * _HELD * STEP_S, 0.5))
        for i, row in enumerate((V_X, V_Y, YAW_RATE))
    ])  # fmt: skip
    measured = np.column_stack(
        [
            np.interp(course.middle_s, e.odometry_s, e.odometry[:, 0]),
            np.interp(course.middle_s, e.odometry_s, e.odometry[:, 1]),
            np.interp(course.middle_s, e.imu_s, e.imu[:, 2]),
        ]
    )
    difference = measured - np.cumsum(own, axis=0)
    residuals = np.column_stack([slopes(x) for x in difference.T])
    names = tuple(FEATURES)
    table = feature_matrix(list(names), feature_signals(course, out))
    kept = np.arange(max(round(_SETTLING_S / STEP_S), HALF), course.steps - HALF, EVERY)
    return EquationErrors(course.middle_s[kept], names, table[kept], residuals[kept], _noise(e))


def _changes(middle: FloatArray, measured: FloatArray, gain: float) -> FloatArray:
    """
    Return what the model changes of a state in each step (n,), without what holds it.

    A run puts out the means of a step's two ends, and then draws the second end towards what was
    measured in the middle by `gain`: taken back step by step from the first state, a measured one.
    """
    out = np.empty_like(middle)
    begin = float(measured[0])
    for k, (mean, seen) in enumerate(zip(middle.tolist(), measured.tolist(), strict=True)):
        out[k] = 2.0 * (mean - begin)
        begin += out[k] + gain * (seen - mean)
    return out


def slopes(x: FloatArray) -> FloatArray:
    """Return the slope (n,) in 1/s of a line fitted to `HALF` steps to either side."""
    k = np.arange(-HALF, HALF + 1, dtype=np.float64)
    return np.asarray(np.convolve(x, -k / (k @ k), mode="same") / STEP_S)


def _noise(e: SensorLog) -> FloatArray:
    """Return the deviation (3,) of a slope by the sensors' white noise."""
    sigma = e.noise()[[3, 4, 2]]
    rates = np.array([np.median(np.diff(at)) for at in (e.odometry_s, e.odometry_s, e.imu_s)])
    samples = (2 * HALF + 1) * STEP_S / rates
    # Of n samples over a time T: sigma sqrt(12 / n) / T.
    return np.asarray(sigma * np.sqrt(12.0 / samples) / ((2 * HALF + 1) * STEP_S))


def _setting(
    course: ResidualProblem, lap: Lap | None, model: SurrogateFile
) -> tuple[FloatArray, ActiveTerms]:
    """Return a model's vector and terms for a run."""
    likelihood = Likelihood.of(course, model.simulator())
    actives = []
    for term in model.terms:
        gate = Activation()
        if term.where.kind == PLACE and lap is not None:
            where = tuple((a, b) for a, b in term.where.stretches)
            gate = Activation(segments=where, lap_length=lap.length, distance=lap.distance)
        elif term.where.kind == TIME:
            gate = Activation(onset_s=term.where.onset_s)
        effect = EFFECTS[term.effect]
        inner = tuple(p.theta(term.parameters[p.name]) for p in effect.parameters)
        actives.append(ActiveEffect(effect, inner, gate))
    return likelihood.simulation_inputs(np.zeros(likelihood.n_nuisances), actives)


def _extra(model: SurrogateFile, course: ResidualProblem, out: FloatArray) -> FloatArray:
    signals = feature_signals(course, out)
    extra = np.zeros((course.steps, 3))
    for piece in model.correction:
        column = STATE_NAMES.index(piece.equation)
        extra[:, column] += piece.coefficient * FEATURES[piece.feature].function(signals)
    return extra
