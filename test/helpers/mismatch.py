# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Generated cases for the tests of the mismatch analysis, each made once."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from adk_ros.bench.mismatch.case_generator import GeneratedCase, InjectedMismatch, make_case
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray

CAR = NominalVehicle(
    mass=1800.0, yaw_inertia=3000.0, cg_to_front_axle=1.25, cg_to_rear_axle=1.4, track_width=1.6
)


@cache
def case(effect: str = "", seed: int = 5, **parameters: float) -> GeneratedCase:
    """A short case with one effect, or with none."""
    injected = InjectedMismatch({effect: parameters}) if effect else InjectedMismatch()
    return make_case(effect or "clean", injected, seed, seconds=(60.0, 90.0, 30.0))


def car(**changes: float) -> FloatArray:
    """Parameters of a car on average tyres, some of them changed."""
    p = CAR.parameters()
    for name, value in changes.items():
        p[INDEX[name]] = value
    return p


def steady(
    speed: float = 20.0, delta: float = 0.0, torque: float = 0.0, seconds: float = 40.0
) -> SensorLog:
    """Sensor log of a car that rolls straight ahead, whatever its commands."""
    imu_s, odometry_s = np.arange(0.005, seconds, 0.01), np.arange(0.005, seconds, 0.02)
    command_s = np.arange(0.0, seconds, 0.025)
    odometry = np.zeros((odometry_s.size, 3))
    odometry[:, 0] = speed
    pose = np.column_stack([speed * odometry_s, 0.0 * odometry_s, 0.0 * odometry_s])
    command = np.tile([torque, delta], (command_s.size, 1))
    return SensorLog(
        "steady",
        seconds,
        imu_s,
        np.zeros((imu_s.size, 3)),
        odometry_s,
        odometry,
        pose,
        command_s,
        command,
    )


def with_commands(log: SensorLog, command: FloatArray) -> SensorLog:
    """The log with other commands (c, 2)."""
    return replace(log, command=command)


def moved(log: SensorLog, angle: float = 0.7, x: float = 5000.0, y: float = -2000.0) -> SensorLog:
    """The log with its poses in another frame."""
    cos, sin = np.cos(angle), np.sin(angle)
    pose = log.pose.copy()
    pose[:, 0] = x + cos * log.pose[:, 0] - sin * log.pose[:, 1]
    pose[:, 1] = y + sin * log.pose[:, 0] + cos * log.pose[:, 1]
    pose[:, 2] += angle
    return replace(log, pose=pose)
