# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Named indices: the surrogate's state, the outputs of a run, the residual channels."""

from __future__ import annotations

A_X, A_Y, YAW_RATE, V_Y, V_X, YAW_ACCELERATION = range(6)
"""Rows of a run's output, each at the middle of a step."""
OUTPUTS = 6

S_V_X, S_V_Y, S_YAW_RATE, S_LOAD_X, S_LOAD_Y = range(5)
S_STEER, S_STEER_MORE, S_PLAY, S_TORQUE, S_TORQUE_MORE = range(5, 10)
S_SLIP = 10
S_X, S_Y, S_HEADING = 14, 15, 16
S_ROLL, S_ROLL_RATE, S_PITCH, S_PITCH_RATE = 17, 18, 19, 20
S_BANK, S_BANK_RATE, S_SLOPE, S_SLOPE_RATE = 21, 22, 23, 24
STATE_SIZE = 25
"""
State vector. S_SLIP is the first of four wheel slip angles; pose in the map frame; roll and pitch
as the steady acceleration that causes them; bank and slope as the sprung mass follows them.
"""

E_V_X, E_V_Y, E_YAW_RATE, E_X, E_Y, E_HEADING = range(6)
"""Columns of a run's end states, each at the end of a step."""
END_STATE_SIZE = 6

IMU_A_X, IMU_A_Y, IMU_YAW_RATE, ODOMETRY_V_X, ODOMETRY_V_Y, ODOMETRY_YAW_RATE = range(6)
"""Rows of residuals: the channels of `recording.sensor_log.CHANNELS`."""
N_CHANNELS = 6
