# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Recordings that no finding can be drawn from: refused in one line, before anything is fitted.

What is checked needs no model: lengths, movement, units and signs of the channels against each
other (yaw rate against heading, v_x against the way driven, specific force against the turning
car), and whether gravity was taken out of the accelerometer.
"""

from __future__ import annotations

import numpy as np

from adk_ros.errors import DataError
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.differentiation import savitzky_golay

MIN_DURATION_S = 30.0
_MIN_SPEED = 2.0
_MIN_MOVING_SHARE = 0.3
_MAX_MASS_RATIO = 2.5
_MAX_STEERING_ANGLE = 1.0
"""rad, that a hundredth of the drive may exceed: lorries and rally cars stay below."""


def check_recording(evidence: SensorLog) -> None:
    """
    Check one recording.

    Raises `DataError`: too short, standing still, wrong units, a flipped sign, no overlap.
    """
    e = evidence
    begin = max(e.imu_s[0], e.odometry_s[0], e.command_s[0])
    end = min(e.imu_s[-1], e.odometry_s[-1], e.command_s[-1])
    if end - begin < MIN_DURATION_S:
        raise DataError(
            f"{e.name}: IMU, odometry and commands overlap for {max(end - begin, 0.0):.1f} s: at "
            f"least {MIN_DURATION_S:g} s of driving are needed"
        )
    moving = np.abs(e.odometry[:, 0]) > _MIN_SPEED
    if moving.mean() < _MIN_MOVING_SHARE:
        raise DataError(
            f"{e.name}: the car stands still, or crawls, for {100 * (1 - moving.mean()):.0f} % of "
            "the time: record a drive"
        )
    _signs(e)
    _varies(e)


def _slope(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return (slope of y over x through their means, their correlation)."""
    x, y = x - x.mean(), y - y.mean()
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if xx <= 0.0 or yy <= 0.0:
        return 0.0, 0.0
    return xy / xx, xy / np.sqrt(xx * yy)


def _signs(e: SensorLog) -> None:
    at = np.arange(e.odometry_s[0], e.odometry_s[-1], 0.02)
    heading = savitzky_golay(np.interp(at, e.odometry_s, e.pose[:, 2]), 51)
    turning = np.gradient(heading, at)
    x = savitzky_golay(np.interp(at, e.odometry_s, e.pose[:, 0]), 51)
    y = savitzky_golay(np.interp(at, e.odometry_s, e.pose[:, 1]), 51)
    along = np.gradient(x, at) * np.cos(heading) + np.gradient(y, at) * np.sin(heading)
    v_x, v_y, rate = (
        savitzky_golay(np.interp(at, e.odometry_s, e.odometry[:, i])) for i in range(3)
    )
    a_x, a_y, gyro = (savitzky_golay(np.interp(at, e.imu_s, e.imu[:, i]), 51) for i in range(3))
    delta = np.interp(at, e.command_s, e.command[:, 1])
    torque = np.interp(at, e.command_s, e.command[:, 0])
    felt_y = v_x * turning + np.gradient(v_y, at)
    felt_x = np.gradient(savitzky_golay(v_x, 51), at) - v_y * turning
    degrees = 180.0 / np.pi
    turned = float(np.quantile(np.abs(delta), 0.99))
    if turned > _MAX_STEERING_ANGLE:
        raise DataError(
            f"{e.name}: the commanded steering angle reaches {turned:.3g} rad, more than wheels "
            "turn: its unit is not rad at the wheels (degrees, or the steering wheel's angle?)"
        )
    pairs = (
        ("odometry's yaw rate", "the heading's change", turning, rate, degrees),
        ("the gyro's yaw rate", "the heading's change", turning, gyro, degrees),
        ("odometry's v_x", "the way driven", along, v_x, 3.6),
        ("the IMU's a_y", "the turning car", felt_y, a_y, 1.0 / GRAVITY),
        ("the IMU's a_x", "the speed's change", felt_x, a_x, 1.0 / GRAVITY),
        ("the commanded steering angle", "the yaw rate", turning, delta * np.sign(v_x), 0.0),
        ("the commanded torque", "the acceleration", felt_x, torque, 0.0),
    )
    for what, against, reference, value, unit in pairs:
        if np.ptp(reference) < 0.05:
            continue
        slope, alike = _slope(reference, value)
        if alike < -0.5:
            raise DataError(
                f"{e.name}: {what} has its sign flipped against {against}: REP-103 has x forward, "
                "y left, z up; turn it round and run again"
            )
        if unit == 0.0 or alike < 0.5:
            continue
        for factor, wrong in ((unit, slope), (1.0 / unit, slope)):
            if abs(np.log(max(wrong, 1e-9) / factor)) < 0.2 and abs(np.log(wrong)) > 0.7:
                raise DataError(
                    f"{e.name}: {what} is {wrong:.3g} times what {against} says: its unit is not "
                    "SI (m/s, m/s^2, rad/s)"
                )


def _varies(e: SensorLog) -> None:
    for name, values in (
        ("odometry's v_y", e.odometry[:, 1]),
        ("odometry's yaw rate", e.odometry[:, 2]),
        ("the IMU's a_x", e.imu[:, 0]),
        ("the IMU's a_y", e.imu[:, 1]),
        ("the commanded torque", e.command[:, 0]),
        ("the commanded steering angle", e.command[:, 1]),
    ):
        if np.ptp(values) == 0.0:
            raise DataError(
                f"{e.name}: {name} is {values[0] + 0.0:g} throughout: it is not measured, and "
                "nothing can be said of what it depends on"
            )


def check_same_vehicle(simulation: SensorLog, recording: SensorLog) -> None:
    """
    Check that two drives have anything in common to compare.

    Raises `DataError` where their speeds do not overlap.
    """
    low_s, high_s = np.percentile(simulation.odometry[:, 0], [2, 98])
    low_r, high_r = np.percentile(recording.odometry[:, 0], [2, 98])
    if high_s < low_r or high_r < low_s:
        raise DataError(
            f"{simulation.name} is driven at {low_s:.0f} to {high_s:.0f} m/s and {recording.name} "
            f"at {low_r:.0f} to {high_r:.0f} m/s: give recordings of like driving"
        )


def check_vehicle(nominal: NominalVehicle, simulation: SensorLog) -> None:
    """
    Check the vehicle's mass and radius against how the simulation answers to torque.

    Raises `DataError` where torque over acceleration is off by a factor of two and a half, where
    the drive is at its most power too.
    """
    heavy = effective_mass(simulation, nominal.wheel_radius)
    gentle = effective_mass(simulation, nominal.wheel_radius, power=0.3)
    if heavy is not None and all(
        not 1.0 / _MAX_MASS_RATIO < mass / nominal.mass < _MAX_MASS_RATIO
        for mass in (heavy, heavy if gentle is None else gentle)
    ):
        raise DataError(
            f"{simulation.name}: its answer to torque is that of {heavy:.0f} kg on wheels of "
            f"{nominal.wheel_radius:g} m, but the vehicle file says {nominal.mass:.0f} kg: it is "
            "another car's"
        )


def effective_mass(e: SensorLog, wheel_radius: float, power: float = 1.0) -> float | None:
    """
    Return the mass in kg that torque seems to drive, or None where it does not tell.

    By the share `power` of the drive in which least of it is asked for.
    """
    at = np.arange(e.odometry_s[0], e.odometry_s[-1], 0.02)
    torque = savitzky_golay(np.interp(at, e.command_s, e.command[:, 0]), 51)
    force = savitzky_golay(np.interp(at, e.imu_s, e.imu[:, 0]), 51)
    asked = np.abs(torque * np.interp(at, e.odometry_s, e.odometry[:, 0]))
    use = asked <= np.quantile(asked, power)
    slope, alike = _slope(torque[use], force[use])
    if alike < 0.5 or slope <= 0.0:
        return None
    return 1.0 / (slope * wheel_radius)
