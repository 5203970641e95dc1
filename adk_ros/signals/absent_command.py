# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The command of a recording that has none: constant zeros at the stamps of odometry.

Training and replay read it, so that the states are predicted from their past and the IMU.
"""

from __future__ import annotations

from adk_ros.signals.channels import Reading, Source

NO_COMMAND_WARNING = (
    "no command: v_x, v_y and yaw rate can only be predicted in reduced scope, from their past "
    "and the IMU, with torque and steering angle taken as constantly 0; record the wheel torque "
    "or a pedal position, and the steering angle"
)


def absent_command(odometry: Reading) -> Reading:
    """Return the command (0 N·m, 0 rad) at the stamp of a reading of odometry."""
    return Reading(Source.COMMAND, odometry.stamp_ns, (0.0, 0.0))
