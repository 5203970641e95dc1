# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Steady-state characteristics: understeer and resistance, measured and simulated on the same inputs.

The surrogate runs along the recording with its commands and its measured speed, without an
observer: v_y and yaw rate are those of the model. From quasi-steady samples,

    understeer:  delta - L r / v  against  a_y = v r       (ISO 4138: steering beyond Ackermann's)
    resistance:  (T / r_w - (m + J / r_w^2) a_x) / m  against  v    (road load over mass)

with the commanded road-wheel angle delta and wheel torque T, wheelbase L, mass m, wheel radius r_w
and spin inertia J of all wheels of the simulation. An accelerometer does not sense gravity, so a
grade is no resistance. Where torque, mass or wheel radius differ from the simulation, this shows
as resistance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.criteria import SETTLING_S
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.residuals import BIN_S, ResidualProblem
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.mismatch.surrogate.state_index import A_X, YAW_RATE
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

MIN_SPEED = 5.0
"""
m/s, of a full-size car. Slower, the angle of the path's curvature is large and its noise as large
as understeer.
"""
RESPONSE_S = 0.2
"""s. Typical response time of yaw rate and lateral acceleration to a step of steering."""
MAX_TRANSIENT_ANGLE = np.radians(0.1)
"""rad. Change of steering within `RESPONSE_S`: the response lags behind by less."""
MAX_CORNERING = 2.0
"""m/s². Above this lateral acceleration, cornering resistance is as large as the road load."""
MAX_ACCELERATION = 3.0
"""m/s². Up to this longitudinal acceleration the slip of a tyre is small and linear."""
MAX_SPEED_CHANGE = 0.5
"""m/s². Up to this longitudinal acceleration, drive forces change the understeer little."""
MAX_FORCE_LAG = 0.3
"""m/s². Change of the drive force over mass within `RESPONSE_S`: its lag is no resistance."""
LINEAR_RANGE = 4.0
"""m/s². Lateral acceleration up to which the understeer gradient is fitted (0.4 g)."""
AIR_DENSITY = 1.225
"""kg/m³, ISO 2533 at sea level: converts the slope of the resistance to a drag area."""
_SMOOTHED = round(0.4 / BIN_S)
"""Residual bins over which signals are averaged before they are differentiated: 0.4 s."""
_SECOND = round(1.0 / BIN_S)
_BINS = 12
"""Most bins of a cross plot."""
_MIN_COUNT = 50
"""Least samples in a bin of a cross plot: two seconds of driving."""
BLOCKS = 20
"""Blocks of contiguous samples that the standard errors leave out in turn (jackknife)."""


@dataclass(frozen=True)
class CrossPlot:
    """
    One quantity y against another, x, SI.

    `x`, `y` (k,): means in bins of equal count. `line` (2,): slope and offset of the straight line
    through the samples; of the resistance against the square of the speed. `left_out`
    (`BLOCKS`, 2): the same without each block of samples.
    """

    x: FloatArray
    y: FloatArray
    line: FloatArray
    left_out: FloatArray


@dataclass(frozen=True)
class Characteristic:
    """
    A cross plot of the recording, and of simulation and corrected model on the same inputs.

    `errors` (2, k): standard error of measured less simulated, and less corrected, in the bins of
    `measured`. `command_size` (k,): in the bins of the simulation, mean size of the command: the
    road-wheel angle, rad, or the drive force over mass, m/s². `seconds`: of quasi-steady driving.
    """

    measured: CrossPlot
    simulation: CrossPlot
    corrected: CrossPlot
    errors: FloatArray
    command_size: FloatArray
    seconds: float


def line_error(left_out: FloatArray) -> FloatArray:
    """
    Return the standard errors (2,) of slope and offset from values without each block.

    Of a difference of two lines, `left_out` is the difference of both. Delete-a-block jackknife:
    B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, SIAM, 1982.
    """
    blocks = left_out.shape[0]
    spread = np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0)
    return np.asarray(np.sqrt((blocks - 1) / blocks * spread))


@dataclass(frozen=True)
class SteadyState:
    """Understeer and resistance; None where a recording has too little quasi-steady driving."""

    understeer: Characteristic | None
    resistance: Characteristic | None
    mass: float
    """kg, of the simulation: converts the resistance over mass to a force."""


def steady_state(likelihood: Likelihood, h: Hypothesis, has_torque: bool) -> SteadyState:
    """Return the characteristics of recording, simulation, and the model corrected by `h`."""
    problem, base = likelihood.problem, likelihood.parameters
    runs = [
        _run(problem, base, likelihood.fixed_terms),
        _run(problem, *likelihood.simulation_inputs(h.nuisances, h.effects)),
    ]
    measured = _measured(problem)
    steady = problem.bin_s >= problem.start_s + SETTLING_S
    slowest = problem.log.similar(MIN_SPEED)
    steady &= measured["v_x"] > slowest
    return SteadyState(
        _understeer(measured, runs, steady, base, slowest),
        _resistance(measured, runs, steady, base) if has_torque else None,
        float(base[INDEX["mass"]]),
    )


def _run(problem: ResidualProblem, p: FloatArray, terms: ActiveTerms) -> dict[str, FloatArray]:
    """Return yaw rate and a_x (b,) of a run with measured speed and without an observer."""
    out = problem.run(p, terms, gain=0.0)
    return {
        "yaw_rate": problem.binned(out[YAW_RATE]),
        "a_x": problem.binned(out[A_X]) + p[INDEX["bias_a_x"]],
    }


def _measured(problem: ResidualProblem) -> dict[str, FloatArray]:
    """Return speed, yaw rate, a_x, torque and road-wheel angle (b,) of the recording."""
    log, bins = problem.log, problem.bins
    torque, delta = problem.mean_commands()
    count = np.bincount(problem.imu_bin, minlength=bins)
    total = np.bincount(problem.imu_bin, log.imu[:, 0], bins)
    return {
        "v_x": problem.binned(problem.smoothed_odometry[:, 0]),
        "yaw_rate": problem.binned(problem.smoothed_odometry[:, 2]),
        "a_x": np.where(count > 0, total / np.maximum(count, 1), np.nan),
        "torque": problem.binned(torque),
        "delta": problem.binned(delta),
    }


def _averaged(values: FloatArray, bins: int = _SMOOTHED) -> FloatArray:
    """Return the moving average over some residual bins."""
    kernel = np.ones(bins)
    count = np.convolve(np.ones(values.shape[0]), kernel, mode="same")
    return np.asarray(np.convolve(values, kernel, mode="same") / count)


def _rate(values: FloatArray) -> FloatArray:
    return np.asarray(np.gradient(_averaged(values), BIN_S))


def _understeer(
    measured: dict[str, FloatArray],
    runs: list[dict[str, FloatArray]],
    steady: BoolArray,
    p: FloatArray,
    slowest: float,
) -> Characteristic | None:
    wheelbase = float(p[INDEX["cg_to_front_axle"]] + p[INDEX["cg_to_rear_axle"]])
    v, delta = measured["v_x"], measured["delta"]
    fast = np.maximum(v, slowest)
    use = (
        steady
        & (np.abs(_rate(delta)) * RESPONSE_S < MAX_TRANSIENT_ANGLE)
        & (np.abs(_rate(v)) < MAX_SPEED_CHANGE)
    )
    rates = [_averaged(run["yaw_rate"]) for run in (measured, *runs)]
    return _characteristic(
        [v * rate for rate in rates],
        [delta - wheelbase * rate / fast for rate in rates],
        np.abs(delta),
        use,
        use & (np.abs(v * rates[0]) < LINEAR_RANGE),
    )


def _resistance(
    measured: dict[str, FloatArray],
    runs: list[dict[str, FloatArray]],
    steady: BoolArray,
    p: FloatArray,
) -> Characteristic | None:
    v = measured["v_x"]
    mass, radius = float(p[INDEX["mass"]]), float(p[INDEX["wheel_radius"]])
    drive = measured["torque"] / (mass * radius)
    inertia = 1.0 + float(p[INDEX["wheel_inertia"]]) / (mass * radius**2)
    use = (
        steady
        & (np.abs(v * measured["yaw_rate"]) < MAX_CORNERING)
        & (np.abs(_averaged(measured["a_x"])) < MAX_ACCELERATION)
        & (np.abs(_rate(drive)) * RESPONSE_S < MAX_FORCE_LAG)
    )
    resistances = [drive - inertia * run["a_x"] for run in (measured, *runs)]
    return _characteristic([v] * 3, resistances, np.abs(drive), use, use, power=2)


def _characteristic(
    x: list[FloatArray],
    y: list[FloatArray],
    size: FloatArray,
    use: BoolArray,
    fitted: BoolArray,
    power: int = 1,
) -> Characteristic | None:
    """Return y against x, measured and of two models; the lines are against x to the power."""
    known = np.isfinite([*x, *y]).all(axis=0)
    use, line = use & known, np.flatnonzero(fitted & known)
    groups = [_groups(values, use) for values in x]
    if not groups[0] or line.size < 5 * _MIN_COUNT or float(np.ptp(x[0][line])) == 0.0:
        return None
    measured, simulation, corrected = (
        _cross_plot(u, w, bins, line, power) for u, w, bins in zip(x, y, groups, strict=True)
    )
    # Samples within a second are not independent, but their white noise is.
    seconds = np.array([max(g.size * BIN_S, 1.0) for g in groups[0]])
    differences = [_averaged(np.nan_to_num(y[0] - model), _SECOND) for model in y[1:]]
    errors = [[difference[g].std() for g in groups[0]] for difference in differences]
    return Characteristic(
        measured,
        simulation,
        corrected,
        np.array(errors) / np.sqrt(seconds),
        np.array([size[g].mean() for g in groups[1]]),
        float(np.count_nonzero(use)) * BIN_S,
    )


def _groups(x: FloatArray, use: BoolArray) -> list[IntArray]:
    """Return the indices of the samples in each bin of equal count, ascending in x."""
    chosen = np.flatnonzero(use)
    count = min(_BINS, chosen.size // _MIN_COUNT)
    if count < 3:
        return []
    return np.array_split(chosen[np.argsort(x[chosen], kind="stable")], count)


def _cross_plot(
    x: FloatArray, y: FloatArray, groups: list[IntArray], line: IntArray, power: int
) -> CrossPlot:
    u, w = x[line] ** power, y[line]
    blocks = np.array_split(np.arange(line.size), BLOCKS)
    return CrossPlot(
        np.array([x[g].mean() for g in groups]),
        np.array([y[g].mean() for g in groups]),
        np.asarray(np.polyfit(u, w, 1)),
        np.array([np.polyfit(np.delete(u, b), np.delete(w, b), 1) for b in blocks]),
    )
