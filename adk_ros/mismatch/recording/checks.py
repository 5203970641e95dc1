# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Checks of a recording before any fit: a recording that cannot be analysed is refused in one line.

The checks need no model. They compare channels with each other: duration, motion, units and signs
(yaw rate against heading, v_x against distance travelled, specific force against the change of
velocity), and whether gravity was removed from the accelerometer.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adk_ros.errors import DataError
from adk_ros.mismatch.recording.frozen_readings import without_frozen_readings
from adk_ros.mismatch.recording.implied_values import ImpliedMass, implied_mass, steering_unit
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.differentiation import savitzky_golay

MIN_DURATION_S = 30.0
"""
Least duration in which IMU, odometry and commands overlap, s: about half a lap of a full-size car.
"""
MIN_MOVING_SPEED = 2.0
"""Speed above which a full-size vehicle counts as moving, m/s."""
_STANDING, _FAST_MODEL = 0.2, 10.0
"""m/s: range of the top speed of a scale model, by choice; it only words a message."""
_MIN_MOVING_SHARE = 0.3
"""Least share of the recording in which the vehicle moves."""
_MAX_MASS_RATIO = 2.5
"""
Largest ratio of implied to nominal mass where torque and speed explain the acceleration poorly.
"""
_MAX_MASS_DIFFERENCE = 0.08
"""
Largest relative difference of the implied from the nominal mass. Practice simulations imply their
mass within 1 %; lags of the drive and unknown rotating parts are left room.
"""
_LOW_POWER_SHARE = 0.3
"""Share of the recording with the lowest power."""
_MAX_UNIT_FACTOR_LOG = 0.5
"""Largest log distance from a factor of 1000 that identifies kN·m: loads differ by less."""
_MAX_STEERING_ANGLE = 1.0
"""Largest 99th percentile of the road-wheel angle, rad: trucks and rally cars stay below it."""
_PERIOD_S = 0.02
"""Period of the common grid on which channels are compared, s."""
_DERIVATIVE_WINDOW_S = 1.02
"""Smoothing window of signals that are differentiated, or compared with a derivative, s."""
_MIN_RANGE = 0.05
"""Least range of a reference signal, SI: below it the manoeuvres do not reveal its sign."""
_MIN_CORRELATION = 0.5
"""Correlation above which a channel follows its reference, and below minus which it is flipped."""
_MAX_FACTOR_LOG = 0.2
"""Largest log distance of a slope from a unit factor that still identifies the unit: 22 %."""
_MIN_UNIT_LOG = 0.7
"""Least log distance of a slope from 1 that counts as a wrong unit: a factor of 2."""
_MAX_STRAIGHT_LATERAL = 1.0
"""
m/s². A lateral acceleration a costs a^2 / C, where C is the cornering stiffness per mass, some 80
m/s² per rad for a car: 0.01 m/s², the least noise assumed of an accelerometer.
"""
_DEGREES = 180.0 / np.pi
_KMH = 3.6
_ANGULAR, _SPECIFIC_FORCE = ("deg/s", "rad/s"), ("g", "m/s²")
"""Usual wrong unit, and the one that is required."""


class _Comparison(NamedTuple):
    """
    A channel and the reference that it should follow.

    `unit_factor` is the slope that the usual wrong unit causes, zero: only the sign is checked;
    `unit`: that unit, and the one that is required.
    """

    channel: str
    reference_name: str
    reference: FloatArray
    values: FloatArray
    unit_factor: float
    unit: tuple[str, str] = ("", "")


def check_recording(
    log: SensorLog, is_simulation: bool = False, needs_steering: bool = True
) -> None:
    """
    Check one recording; a simulation must have every channel.

    :param needs_steering: whether a car that turns must have a steering angle.

    :raises DataError: the recording is too short or mostly stationary, a unit or a sign is wrong,
        or a channel is constant that must not be.
    """
    begin = max(log.imu_s[0], log.odometry_s[0], log.command_s[0])
    end = min(log.imu_s[-1], log.odometry_s[-1], log.command_s[-1])
    least = log.similar(MIN_DURATION_S)
    if end - begin < least:
        raise DataError(
            f"{log.name}: IMU, odometry and commands overlap for {max(end - begin, 0.0):.1f} s; "
            f"the analysis needs at least {least:.3g} s of driving"
        )
    slowest = log.similar(MIN_MOVING_SPEED)
    moving = np.abs(log.odometry[:, 0]) > slowest
    if moving.mean() < _MIN_MOVING_SHARE:
        raise DataError(
            f"{log.name}: the vehicle is slower than {slowest:.3g} m/s for "
            f"{100 * (1 - moving.mean()):.0f} % of the recording; at most "
            f"{100 * (1 - _MIN_MOVING_SHARE):.0f} % is allowed: record more driving"
            f"{_on_size(log)}"
        )
    _check_signs_and_units(_live(log))
    _check_variation(log, is_simulation, needs_steering and turns(log))


def _live(log: SensorLog) -> SensorLog:
    """
    Return a recording without frozen readings, if half of it and more is left.

    When a frozen pose goes on, it jumps: its rate of change there, a hundred times the speed,
    would decide the comparison.
    """
    live = without_frozen_readings(log)[0]
    is_most = (
        2 * live.imu_s.size >= log.imu_s.size and 2 * live.odometry_s.size >= log.odometry_s.size
    )
    return live if is_most else log


def _on_size(log: SensorLog) -> str:
    """Return what to do if the vehicle is a scale model and nothing says so."""
    fastest = float(np.percentile(np.abs(log.odometry[:, 0]), 99.0))
    if log.length_scale < 1.0 or not _STANDING < fastest < _FAST_MODEL:
        return ""
    return "; for a scale model, give its mass and wheelbase as --vehicle"


def _regression(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return (slope of y over x, correlation), both about the means."""
    x, y = x - x.mean(), y - y.mean()
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if xx <= 0.0 or yy <= 0.0:
        return 0.0, 0.0
    return xy / xx, xy / np.sqrt(xx * yy)


def _check_signs_and_units(log: SensorLog) -> None:
    """Raise `DataError` where a channel contradicts the motion of the vehicle."""
    largest = float(np.quantile(np.abs(_on_grid(log, log.command_s, log.command[:, 1])), 0.99))
    if largest > _MAX_STEERING_ANGLE:
        unit = steering_unit(log) or "degrees, or the hand-wheel angle"
        raise DataError(
            f"{log.name}: the commanded steering angle reaches {largest:.3g} rad, more than road "
            f"wheels can turn: its unit is not rad at the road wheels (it looks like {unit})"
        )
    for comparison in _comparisons(log):
        _check_comparison(log.name, comparison)


def _comparisons(log: SensorLog) -> tuple[_Comparison, ...]:
    """Return the channels with their references on a common grid."""
    at, window_s = _grid(log), log.similar(_DERIVATIVE_WINDOW_S)
    x, y, heading = (
        _smooth(_on_grid(log, log.odometry_s, log.pose[:, i]), window_s) for i in range(3)
    )
    heading_rate = np.gradient(heading, at)
    speed = np.gradient(x, at) * np.cos(heading) + np.gradient(y, at) * np.sin(heading)
    v_x, v_y, yaw_rate = (
        savitzky_golay(_on_grid(log, log.odometry_s, log.odometry[:, i]), _PERIOD_S)
        for i in range(3)
    )
    a_x, a_y, gyro = (_smooth(_on_grid(log, log.imu_s, log.imu[:, i]), window_s) for i in range(3))
    delta = _on_grid(log, log.command_s, log.command[:, 1])
    torque = _on_grid(log, log.command_s, log.command[:, 0])
    lateral = v_x * heading_rate + np.gradient(v_y, at)
    forward = np.gradient(_smooth(v_x, window_s), at) - v_y * heading_rate
    rate, change = (
        "the rate of change of the heading",
        "the longitudinal acceleration of the odometry",
    )
    return (
        _Comparison("odometry's yaw rate", rate, heading_rate, yaw_rate, _DEGREES, _ANGULAR),
        _Comparison("the gyro's yaw rate", rate, heading_rate, gyro, _DEGREES, _ANGULAR),
        _Comparison(
            "odometry's v_x",
            "the rate of change of the position",
            speed,
            v_x,
            _KMH,
            ("km/h", "m/s"),
        ),
        _Comparison(
            "the IMU's a_y",
            "the lateral acceleration of the odometry",
            lateral,
            a_y,
            1.0 / GRAVITY,
            _SPECIFIC_FORCE,
        ),
        _Comparison("the IMU's a_x", change, forward, a_x, 1.0 / GRAVITY, _SPECIFIC_FORCE),
        _Comparison(
            "the commanded steering angle", "the yaw rate", heading_rate, delta * np.sign(v_x), 0.0
        ),
        _Comparison("the commanded torque", change, forward, torque, 0.0),
    )


def _grid(log: SensorLog) -> FloatArray:
    """Return the times of the common grid, s."""
    return np.arange(log.odometry_s[0], log.odometry_s[-1], _PERIOD_S)


def _on_grid(log: SensorLog, at_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return a channel interpolated on the common grid."""
    return np.interp(_grid(log), at_s, values)


def _smooth(values: FloatArray, window_s: float) -> FloatArray:
    """Return values on the common grid, smoothed."""
    return savitzky_golay(values, _PERIOD_S, window_s)


def _check_comparison(name: str, c: _Comparison) -> None:
    """Raise `DataError` if a channel has the wrong sign or unit."""
    if np.ptp(c.reference) < _MIN_RANGE:
        return
    slope, correlation = _regression(c.reference, c.values)
    if correlation < -_MIN_CORRELATION:
        raise DataError(
            f"{name}: {c.channel} has its sign flipped against {c.reference_name}: REP-103 "
            "requires x forward, y left, z up; correct the sign and run again"
        )
    if c.unit_factor == 0.0 or correlation < _MIN_CORRELATION:
        return
    for factor in (c.unit_factor, 1.0 / c.unit_factor):
        near_factor = abs(np.log(max(slope, 1e-9) / factor)) < _MAX_FACTOR_LOG
        if near_factor and abs(np.log(slope)) > _MIN_UNIT_LOG:
            wrong, right = c.unit
            looks = f"it looks like {wrong}"
            if factor != c.unit_factor:
                looks = f"it, or what it is compared with, was converted from {wrong} twice"
            raise DataError(
                f"{name}: {c.channel} is {slope:.3g} times {c.reference_name}: {looks}, the topic "
                f"must carry {right} (a factor of {c.unit_factor:.3g})"
            )


def _check_variation(log: SensorLog, is_simulation: bool, needs_steering: bool) -> None:
    """
    Raise `DataError` if a channel is constant that must not be.

    A recording may lack some, see `dead_channels`; a car that steers has a yaw rate, and one that
    turns a steering angle: its tyres' drag in bends would be taken for missing physics.
    """
    steers = bool(np.ptp(log.command[:, 1]) > 0.0)
    for name, values, required in (
        ("odometry's v_y", log.odometry[:, 1], is_simulation),
        ("odometry's yaw rate", log.odometry[:, 2], is_simulation or steers),
        ("the IMU's a_x", log.imu[:, 0], True),
        ("the IMU's a_y", log.imu[:, 1], is_simulation),
        ("the commanded torque", log.command[:, 0], is_simulation),
        ("the commanded steering angle", log.command[:, 1], is_simulation or needs_steering),
    ):
        if required and np.ptp(values) == 0.0:
            raise DataError(
                f"{log.name}: {name} is {values[0] + 0.0:g} throughout: it is not measured, and "
                "nothing can be compared without it; record it"
            )


def turns(log: SensorLog) -> bool:
    """Whether the car drives bends in which the tyres' side forces slow it down noticeably."""
    lateral = np.abs(log.odometry[:, 0] * log.odometry[:, 2])
    return bool(np.percentile(lateral, 99.0) > _MAX_STRAIGHT_LATERAL)


def check_same_vehicle(simulation: SensorLog, recording: SensorLog) -> None:
    """
    Check that the speeds of two recordings overlap.

    :raises DataError: they do not.
    """
    low_s, high_s = np.percentile(simulation.odometry[:, 0], [2, 98])
    low_r, high_r = np.percentile(recording.odometry[:, 0], [2, 98])
    if high_s < low_r or high_r < low_s:
        raise DataError(
            f"the speeds of {simulation.name} ({low_s:.0f} to {high_s:.0f} m/s) and of "
            f"{recording.name} ({low_r:.0f} to {high_r:.0f} m/s) do not overlap: give recordings "
            "of similar driving"
        )


def check_vehicle(nominal: NominalVehicle, simulation: SensorLog) -> ImpliedMass | None:
    """
    Check mass and wheel radius of the vehicle file against the simulation's torque response.

    Return the mass that it implies: over the whole recording if that is accurate, otherwise over
    its part of low power. None where torque and speed do not explain the acceleration.

    :raises DataError: the torque is in kN·m or no torque at all, or the implied mass differs by
        more than 8 %, both over the whole recording and over its part of low power, which a power
        limit does not affect. Where torque and speed do not explain the acceleration well, the
        mass must be outside the interval, or differ by a factor of 2.5 if that is so in both.
    """
    radius, inertia = nominal.wheel_radius, 4.0 * nominal.wheel_inertia
    check_torque_unit(simulation, nominal.mass, radius)
    overall = implied_mass(simulation, radius, inertia)
    rotating = inertia / radius**2
    if overall is not None and overall.value <= 0.0:
        factor = (nominal.mass + rotating) / (overall.value + rotating)
        raise DataError(
            f"{simulation.name}: the commanded torque is about {_mass(factor)} times too small "
            f"for a car of {_mass(nominal.mass)} kg, less than its wheels alone need: a pedal "
            "position or another unit; the topic must carry the torque of all wheels in N·m"
        )
    low_power = implied_mass(simulation, radius, inertia, _LOW_POWER_SHARE)
    masses = [] if overall is None else [overall, low_power or overall]
    is_known = any(implied.is_accurate for implied in masses)
    if overall is not None and all(
        _contradicts(implied, nominal.mass, is_known) for implied in masses
    ):
        at_that_mass = overall.radius_at(nominal.mass, radius)
        raise DataError(
            f"{simulation.name}: the torque response implies a mass of {_mass(overall.value)} "
            f"kg ({_mass(overall.low)} to {_mass(overall.high)}) on wheels of {radius:.3g} m "
            f"radius, but the vehicle file says {_mass(nominal.mass)} kg: correct its mass, "
            "wheel_radius or wheel_inertia (with that mass, the radius would be "
            f"{at_that_mass[0]:.3g} m, {at_that_mass[1]:.3g} to {at_that_mass[2]:.3g})"
        )
    return next((x for x in masses if x.is_accurate), masses[-1] if masses else None)


def torque_response_text(implied: ImpliedMass | None, nominal: NominalVehicle) -> str:
    """Return the result of `check_vehicle` in words, next to the values of the vehicle file."""
    if implied is None:
        return (
            "the simulation's torque response implies no mass, since it drives too little with "
            "little lateral acceleration, or torque and speed explain too little of its "
            "acceleration: mass and wheel_radius are not checked"
        )
    radius, low, high = implied.radius_at(nominal.mass, nominal.wheel_radius)
    source = "assumed" if "wheel_radius" in nominal.assumed else "vehicle file"
    text = (
        f"the simulation's torque response implies a mass of {_mass(implied.value)} kg "
        f"({_mass(implied.low)} to {_mass(implied.high)}; vehicle file {_mass(nominal.mass)}) "
        f"with a wheel radius of {nominal.wheel_radius:.4g} m ({source}), or, with the file's "
        f"mass, a wheel radius of {radius:.4g} m ({low:.4g} to {high:.4g})"
    )
    if implied.is_accurate:
        return text
    return (
        f"{text}, where torque and speed explain only {100.0 * implied.determination:.0f} % of "
        "the acceleration: these intervals may be too narrow"
    )


def _mass(value: float) -> str:
    """Return a mass in kg in words, also that of a scale model."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _contradicts(implied: ImpliedMass, mass: float, is_known: bool) -> bool:
    """
    Whether an implied mass contradicts that of the vehicle file.

    `is_known`: this one or the one of the other part is accurate. The interval of one that is not
    may be too narrow; alone it only shows a gross difference.
    """
    largest = 1.0 + _MAX_MASS_DIFFERENCE
    if implied.is_accurate:
        return not 1.0 / largest < implied.value / mass < largest
    if is_known:
        return not implied.low < mass < implied.high
    return not 1.0 / _MAX_MASS_RATIO < implied.value / mass < _MAX_MASS_RATIO


def check_torque_unit(recording: SensorLog, mass: float, wheel_radius: float) -> None:
    """
    Check that the commanded torque is in N·m, for a car of about this mass.

    :raises DataError: it is about 1000 times too small.
    """
    implied = implied_mass(recording, wheel_radius)
    if (
        implied is not None
        and implied.is_accurate
        and (abs(np.log(1000.0 * implied.value / mass)) < _MAX_UNIT_FACTOR_LOG)
    ):
        raise DataError(
            f"{recording.name}: the commanded torque is about 1000 times too small for a car of "
            f"{_mass(mass)} kg: it looks like kN·m, the topic must carry N·m"
        )
