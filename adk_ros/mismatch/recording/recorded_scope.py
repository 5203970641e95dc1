# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the channels of a recording allow to predict, judge and calibrate (`calibration.scope`)."""

from __future__ import annotations

import numpy as np

from adk_ros.calibration.scope import Scope, scope_of_streams
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.commands import COMMAND_TYPES


def recorded_scope(log: SensorLog) -> list[Scope]:
    """Return what a recording allows, row by row, as `adk info` does for its bag."""
    imu = _stream("the IMU", log.imu_s, {"a_x": 0, "a_y": 1, "w_z": 2}, log.imu)
    if imu is not None:
        # A sensor log holds what moves in the plane.
        imu = imu.having(**dict.fromkeys(("a_z", "w_x", "w_y"), np.full(imu.at_s.shape, np.nan)))
    odometry = _stream(
        "odometry", log.odometry_s, {"v_x": 0, "v_y": 1, "yaw_rate": 2}, log.odometry
    )
    if odometry is not None:
        pose = dict(zip(("x", "y", "heading"), log.pose.T, strict=True))
        odometry = odometry.having(**pose)
        if not log.measures_v_y and odometry.has("v_y"):
            # An estimate.
            odometry = odometry.having(v_y=np.full(odometry.at_s.shape, np.nan))
    command = None
    if log.has_command:
        command = _stream("the command", log.command_s, {"torque": 0, "steering": 1}, log.command)
    attitude = _stream("the attitude", log.attitude_s, {"roll": 0, "pitch": 1}, log.attitude)
    streams = Streams(log.name, log.duration_s, imu, odometry, command, attitude=attitude)
    inferred = log.torque_is_inferred
    kind = next(key for key, x in COMMAND_TYPES.items() if x.inferred_torque == inferred)
    # Without a vehicle file every car counts as full-size.
    return scope_of_streams(streams, kind, log.length_scale if log.length_scale < 1.0 else None)


def _stream(
    name: str, at_s: FloatArray, columns: dict[str, int], values: FloatArray
) -> Stream | None:
    if not at_s.size:
        return None
    return Stream(name, at_s, {column: values[:, i] for column, i in columns.items()})
