# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Channels of a recording that are constant: published, but not measured.

A car without a sensor often publishes zeros in its place. Such a channel is taken for absent, and
what needs it is left out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adk_ros.mismatch.recording.sensor_log import SensorLog

_IMU_CHANNELS = ("a_x", "a_y", "yaw rate")


def without_dead_channels(log: SensorLog) -> tuple[SensorLog, list[str]]:
    """
    Return a recording without the channels that are constant, and a line for each.

    An IMU with one constant channel is left out as a whole. A constant v_y counts as not measured,
    and so does an estimated one;
    constant commands stay, see `inference.observability`.
    """
    lines = []
    if log.imu_s.size:
        for name, values in zip(_IMU_CHANNELS, log.imu.T, strict=True):
            if np.ptp(values) == 0.0:
                lines.append(
                    f"{log.name}: the IMU's {name} is {values[0] + 0.0:g} throughout: the IMU is "
                    "left out"
                )
                log = replace(log, imu_s=np.empty(0), imu=np.empty((0, 3)))
                break
    if np.ptp(log.odometry[:, 1]) == 0.0 or not log.measures_v_y:
        odometry = log.odometry.copy()
        odometry[:, 1] = 0.0
        log = replace(log, odometry=odometry, measures_v_y=False)
    return log, lines
