# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Write a sensor log as a bag."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np

from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.offline.export import write_bag
from adk_ros.plant.scenario.sensor_simulation import START_NS, SimulatedDrive
from adk_ros.plant.scenario.sensors import Sensors, Stream
from adk_ros.signals.channels import Source


def write_sensor_log(log: SensorLog, path: Path, start_ns: int = START_NS) -> None:
    """Write the streams of a sensor log as a bag; stamps count from `start_ns`."""

    def stream(at_s: FloatArray, values: FloatArray) -> Stream:
        at = start_ns + np.rint(at_s * 1e9).astype(np.int64)
        return Stream(at, at, np.ascontiguousarray(values))

    e = log
    streams = {
        Source.IMU: stream(e.imu_s, e.imu),
        Source.ODOMETRY: stream(e.odometry_s, np.column_stack([e.odometry, e.pose])),
        Source.COMMAND: stream(e.command_s, e.command),
    }
    # `write_bag` reads only these fields; of the readings only their number.
    readings = range(sum(len(s.stamp_ns) for s in streams.values()))
    drive = SimpleNamespace(
        streams=streams, sensors=Sensors(), readings=readings, attitude=None, wheels=None
    )
    write_bag(cast(SimulatedDrive, drive), path)
