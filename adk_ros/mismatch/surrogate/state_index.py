# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The stand-in's state and what a run of it puts out, by name."""

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
Named state: slips are of the four wheels, the pose is of the map; roll and pitch as the steady
acceleration that they belong to; bank and slope as far as a body on springs has followed the road.
"""
