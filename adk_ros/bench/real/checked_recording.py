# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read a recording with the parameters that `adk check` proposes for it, as its how-to says."""

from __future__ import annotations

from pathlib import Path

from adk_ros.bags.recording import RecordingOptions
from adk_ros.calibration.check import check
from adk_ros.calibration.from_bag import read_streams
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.signals.decode import SensorConfig


def read_checked(path: Path, nominal: NominalVehicle) -> SensorLog:
    """
    Return a recording of the nominal vehicle, which may be without an IMU, as checked.

    :raises DataError: the recording is not usable.
    :raises UsageError: the proposed parameters contradict each other.
    """
    sensors = proposed_sensors(path, nominal)
    return read_sensor_log(path, RecordingOptions(sensors=sensors), needs_imu=False)


def proposed_sensors(path: Path, nominal: NominalVehicle) -> SensorConfig:
    """
    Return the parameters with which `adk check` proposes to read a recording.

    :raises DataError: the recording is not usable.
    :raises UsageError: the proposed parameters contradict each other.
    """
    content = read_streams(path, RecordingOptions())
    return check(content, nominal, assumed=nominal.assumed).corrected(content.sensors)
