# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Equation-error residuals: measured minus modelled accelerations, the same for every method.

The model is simulated with a strong observer that keeps its state at the measurement, so each
equation is evaluated separately. Residual: d/dt of the measured v_x, v_y (odometry) and yaw rate
(gyro, if there is one) minus that of the model, both as slopes of lines fitted over 0.5 s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.observability import with_pseudo_imu
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import PLACE, TIME
from adk_ros.mismatch.library.features import FEATURES, feature, feature_matrix
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.feature_terms import EQUATION_PARAMETERS, feature_signals
from adk_ros.mismatch.surrogate.lap import Lap, find_lap
from adk_ros.mismatch.surrogate.residuals import (
    STEP_S,
    ResidualProblem,
    observer_shares,
    prepare_residual_problem,
)
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.mismatch.surrogate.state_index import V_X, V_Y, YAW_RATE
from adk_ros.numerics.arrays import FloatArray

HALF = 25
"""Half width of the slope fit, grid steps (0.25 s)."""
EVERY = 4
"""Grid steps from one row to the next."""
_OBSERVER_FACTOR = 10.0
"""Factor on the observer gains that keeps the state at the measurement."""
_SETTLING_S = 1.5
"""Start of the recording that is left out, s."""


@dataclass(frozen=True)
class EquationErrors:
    """
    `time_s` (n,), `features` (n, k) named `names`, `residuals` (n, 3) of v_x, v_y, yaw rate.

    `noise` (3,): standard deviation of a residual due to sensor noise.
    """

    time_s: FloatArray
    names: tuple[str, ...]
    features: FloatArray
    residuals: FloatArray
    noise: FloatArray


def equation_errors(recording: SensorLog, model: SurrogateFile) -> EquationErrors:
    """Return the residuals of a recording for a surrogate with its effects and feature terms."""
    e = with_pseudo_imu(recording)
    course = prepare_residual_problem(e)
    vector, terms = _setting(course, find_lap(course), model)
    out = course.run(vector, terms, _OBSERVER_FACTOR)
    if model.feature_terms:
        out = course.run(vector, terms, _OBSERVER_FACTOR, _extra(model, course, out))
    shares = observer_shares(_OBSERVER_FACTOR)
    modelled = np.column_stack([
        _changes(out[row], course.smoothed_odometry[:, i], shares[i])
        for i, row in enumerate((V_X, V_Y, YAW_RATE))
    ])  # fmt: skip
    measured = np.column_stack(
        [
            np.interp(course.middle_s, e.odometry_s, e.odometry[:, 0]),
            np.interp(course.middle_s, e.odometry_s, e.odometry[:, 1]),
            np.interp(course.middle_s, e.imu_s, e.imu[:, 2]),
        ]
    )
    difference = measured - np.cumsum(modelled, axis=0)
    residuals = np.column_stack([slopes(x) for x in difference.T])
    names = tuple(FEATURES)
    table = feature_matrix(list(names), feature_signals(course, out))
    kept = np.arange(max(round(_SETTLING_S / STEP_S), HALF), course.steps - HALF, EVERY)
    return EquationErrors(course.middle_s[kept], names, table[kept], residuals[kept], _noise(e))


def _changes(middle: FloatArray, measured: FloatArray, gain: float) -> FloatArray:
    """
    Return the change of a state by the model in each step (n,), without the observer correction.

    `middle` holds the mean of the state at both ends of a step; the observer then corrects the end
    by `gain` times the innovation. This inverts both, starting from the measured first state.
    """
    out = np.empty_like(middle)
    begin = float(measured[0])
    for k, (mean, value) in enumerate(zip(middle.tolist(), measured.tolist(), strict=True)):
        out[k] = 2.0 * (mean - begin)
        begin += out[k] + gain * (value - mean)
    return out


def slopes(x: FloatArray) -> FloatArray:
    """Return the slope (n,), 1/s, of a line fitted to `HALF` steps to either side."""
    k = np.arange(-HALF, HALF + 1, dtype=np.float64)
    return np.asarray(np.convolve(x, -k / (k @ k), mode="same") / STEP_S)


def _noise(e: SensorLog) -> FloatArray:
    """Return the standard deviation (3,) of a slope due to white sensor noise."""
    sigma = e.noise()[[3, 4, 2]]
    rates = np.array([np.median(np.diff(at)) for at in (e.odometry_s, e.odometry_s, e.imu_s)])
    samples = (2 * HALF + 1) * STEP_S / rates
    # Line fit to n samples over a time T: sigma sqrt(12 / n) / T.
    return np.asarray(sigma * np.sqrt(12.0 / samples) / ((2 * HALF + 1) * STEP_S))


def _setting(
    course: ResidualProblem, lap: Lap | None, model: SurrogateFile
) -> tuple[FloatArray, ActiveTerms]:
    """Return the parameter vector and the active terms of a model."""
    likelihood = Likelihood.of(course, model.surrogate())
    actives = []
    for term in model.terms:
        gate = Activation()
        if term.where.kind == PLACE and lap is not None:
            gate = Activation(
                segments=tuple((a, b) for a, b in term.where.stretches),
                lap_length=lap.length,
                distance=lap.distance,
                transition_length=term.where.edge,
            )
        elif term.where.kind == TIME:
            gate = Activation(onset_s=term.where.onset_s)
        effect = EFFECTS[term.effect]
        theta = tuple(p.theta(term.parameters[p.name]) for p in effect.parameters)
        actives.append(ActiveEffect(effect, theta, gate))
    return likelihood.simulation_inputs(np.zeros(likelihood.n_nuisances), actives)


def _extra(model: SurrogateFile, course: ResidualProblem, out: FloatArray) -> FloatArray:
    """Return what the feature terms add (n, 4), see `RunInputs.extra`."""
    signals = feature_signals(course, out)
    columns = list(EQUATION_PARAMETERS)
    extra = np.zeros((course.steps, len(columns)))
    for piece in model.feature_terms:
        column = columns.index(piece.equation)
        extra[:, column] += piece.coefficient * feature(piece.feature).function(signals)
    return extra
