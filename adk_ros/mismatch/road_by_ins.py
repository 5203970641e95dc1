# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Grade and bank of the road from the attitude of an inertial navigation system.

The attitude is that of the body, whose angle theta follows the road and the specific force with a
second-order lag, and whose accelerometer senses the difference (`surrogate.equations_of_motion`):

    theta'' / omega² + 2 zeta theta' / omega + theta = slope + gradient f
    a = f + g (theta - slope)

theta is minus the pitch for the grade and f_x, the roll for the bank and f_y. With gradient,
frequency and damping of the surrogate model, both give the slope. Where the road closes, its grade
has a mean of zero over whole laps; elsewhere the level of the attitude is that of its mounting.
Specific force and velocity show the same angles, g sin(angle) = a_x + r v_y - dv_x/dt and
a_y - r v_x - dv_y/dt; what they deviate by bounds the error of the attitude.

A slope is used where it lowers the open-loop error of its velocity at every horizon. Nothing is
fitted for that, but all of the recording counts, also the part that is held out afterwards: the
errors there are not independent of this choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import yaml

from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.held_out import HORIZONS_S, Evidence, horizon_errors, rmse
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.measured_road import SLOPES, MeasuredRoad
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.equations_of_motion import MIN_BODY_GRADIENT
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.lap import find_lap
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.differentiation import savitzky_golay
from adk_ros.signals.channels import STATE_NAMES

_PERIOD_S = 0.02
_SMOOTHING_S = 0.5
"""s over which angles and accelerations are smoothed; a wheelbase at 6 m/s."""
MOUNTING_SIGMA = np.radians(0.5)
"""
rad; standard deviation of the level of an attitude: half of the smallest tilt of an IMU that `adk
check` reports (`calibration.criteria`, tilt).
"""
LAP_SIGMA = 0.002
"""
rad; the same of a grade whose mean over whole laps is zero: a lap of 2 km that ends 4 m higher or
lower, as an odometry without height may take a junction for a closed lap. By choice.
"""
_MIN_LAP_SHARE = 0.9
"""Share of a lap that must be driven for its mean."""
_GRAVITY_STATE = {"grade": 0, "bank": 1}
"""Velocity that each slope acts on, by its index."""


def with_measured_roads(
    logs: Sequence[SensorLog], surrogate: SurrogateModel
) -> tuple[list[SensorLog], list[str]]:
    """
    Return recordings with the slopes that their attitude measures, and a line on each.

    A slope is used in all of them or in none. Unchanged where a recording has no attitude.
    """
    roads = [measured_road(log, surrogate) for log in logs]
    if not roads or any(road is None for road in roads):
        return list(logs), []
    with_roads = [replace(log, road=road) for log, road in zip(logs, roads, strict=True)]
    before, after = _errors(logs, surrogate), _errors(with_roads, surrogate)
    used = []
    for name, state in _GRAVITY_STATE.items():
        if all(log.measures_v_y for log in logs) or name == "grade":
            better = after[:, state] < before[:, state]
            used += [name] if better.all() else []
    out = [
        replace(log, road=None if log.road is None else log.road.only(used)) for log in with_roads
    ]
    if not used:
        return list(logs), [_rejected(before, after)]
    return out, [_note(name, out, before, after) for name in used]


def with_measured_road(log: SensorLog, surrogate: SurrogateModel, like: SensorLog) -> SensorLog:
    """Return a further recording with the slopes that are used in another one."""
    road = None if like.road is None else measured_road(log, surrogate)
    if road is None or like.road is None:
        return log
    return replace(log, road=road.only(like.road.entries))


def levelled(
    evidence: Sequence[Evidence], nuisances: FloatArray, directions: FloatArray
) -> list[Evidence]:
    """
    Return evidence whose measured slopes have the levels that a fit found.

    :param nuisances: (k,) along `directions` (k, SIZE), of which the last are those levels.
    """

    def raised(road: MeasuredRoad | None) -> MeasuredRoad | None:
        if road is None:
            return None
        count = len(road.entries)
        found = nuisances[-count:] @ directions[-count:]
        return road.raised({name: float(found[INDEX[name]]) for name in road.entries})

    return [replace(x, log=replace(x.log, road=raised(x.log.road))) for x in evidence]


def measured_road(log: SensorLog, surrogate: SurrogateModel) -> MeasuredRoad | None:
    """Return grade and bank by the attitude of a recording; None without one."""
    if log.attitude_s.size < 2 or not log.imu_s.size:
        return None
    at_s = np.arange(log.odometry_s[0], log.odometry_s[-1], _PERIOD_S)

    def smooth(times: FloatArray, values: FloatArray) -> FloatArray:
        return savitzky_golay(np.interp(at_s, times, values), _PERIOD_S, _SMOOTHING_S)

    roll, pitch = (smooth(log.attitude_s, log.attitude[:, i]) for i in range(2))
    a_x, a_y, rate = (smooth(log.imu_s, log.imu[:, i]) for i in range(3))
    v_x, v_y = (smooth(log.odometry_s, log.odometry[:, i]) for i in range(2))
    along = a_x + rate * v_y - np.gradient(v_x, _PERIOD_S)
    across = a_y - rate * v_x - np.gradient(v_y, _PERIOD_S)
    angles = [-pitch, roll]
    values = [
        _slope(angle, force, surrogate, axis)
        for angle, force, axis in zip(angles, (a_x, a_y), ("pitch", "roll"), strict=True)
    ]
    sigma = np.full(2, MOUNTING_SIGMA)
    level = _level_by_laps(log, at_s, values[0])
    if level is not None:
        values[0], sigma[0] = values[0] - level, LAP_SIGMA
    errors = [
        angle - np.arcsin(np.clip(seen / GRAVITY, -1.0, 1.0))
        for angle, seen in zip(angles, (along, across), strict=True)
    ]
    if not log.measures_v_y:
        # Its change is unknown, so that nothing is left to compare with.
        errors[1] = np.zeros_like(errors[1])
    centred = np.array([error - np.mean(error) for error in errors])
    return MeasuredRoad(at_s, SLOPES, np.array(values), centred, sigma)


def _slope(
    angle: FloatArray, acceleration: FloatArray, surrogate: SurrogateModel, axis: str
) -> FloatArray:
    """Return the slope (m,) under a body with this angle and this reading of its accelerometer."""
    gradient, frequency, damping = (
        float(surrogate.parameters[INDEX[f"{axis}_{name}"]])
        for name in ("gradient", "frequency", "damping")
    )
    if gradient <= MIN_BODY_GRADIENT:
        return angle
    change = np.gradient(angle, _PERIOD_S)
    ahead = angle + 2.0 * damping / frequency * change
    ahead += np.gradient(change, _PERIOD_S) / frequency**2
    numerator = ahead + gradient * (GRAVITY * angle - acceleration)
    return np.asarray(numerator / (1.0 + GRAVITY * gradient))


def _level_by_laps(log: SensorLog, at_s: FloatArray, grade: FloatArray) -> float | None:
    """Return the mean of a grade over whole laps, weighted by distance; None without a lap."""
    problem = prepare_residual_problem(log)
    lap = find_lap(problem)
    if lap is None:
        return None
    known = np.isfinite(lap.distance)
    driven = np.interp(at_s, problem.middle_s[known], lap.unwrapped[known])
    whole = np.floor((driven[-1] - driven[0]) / lap.length)
    if whole < 1.0:
        return None
    end = int(np.argmax(driven >= driven[0] + whole * lap.length)) or driven.size
    distance = np.abs(np.diff(driven[:end]))
    if float(distance.sum()) < _MIN_LAP_SHARE * lap.length:
        return None
    # The height of a closed path is that at its start.
    middle = 0.5 * (np.sin(grade[:end])[1:] + np.sin(grade[:end])[:-1])
    return float(np.average(middle, weights=distance))


def _errors(logs: Sequence[SensorLog], surrogate: SurrogateModel) -> FloatArray:
    """Return the open-loop RMSE (horizons, 3) of the simulation on recordings."""
    model = validate("simulation", yaml.safe_load(simulation_yaml(surrogate)), SurrogateFile)
    return rmse(horizon_errors(model, [Evidence(log) for log in logs]))


def _note(name: str, logs: Sequence[SensorLog], before: FloatArray, after: FloatArray) -> str:
    roads = [log.road and log.road.only([name]) for log in logs]
    values = np.concatenate([road.values[0] for road in roads if road is not None])
    tangent = 100.0 * np.tan(values)
    state, horizon = _GRAVITY_STATE[name], HORIZONS_S.index(1.0)
    return (
        f"the {name} of the road is measured by the attitude of the recording: "
        f"{tangent.min():.1f} to {tangent.max():.1f} %, RMS {np.sqrt(np.mean(tangent**2)):.1f} %; "
        f"it is no missing physics, and lowers the error of {STATE_NAMES[state]}, predicted 1 s "
        f"ahead by the simulation, from {before[horizon, state]:.3g} to "
        f"{after[horizon, state]:.3g} m/s"
    )


def _rejected(before: FloatArray, after: FloatArray) -> str:
    horizon = HORIZONS_S.index(1.0)
    return (
        "the attitude of the recording is not used: with its grade, the error of v_x, predicted "
        f"1 s ahead by the simulation, is {after[horizon, 0]:.3g} instead of "
        f"{before[horizon, 0]:.3g} m/s"
    )
