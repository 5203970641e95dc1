# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Torque of a recording that has none, from its motion.

A pedal position, or no drive command at all, says nothing of longitudinal forces. The lateral
dynamics need them all the same: they shift the wheel loads and take a share of the tyres' grip.
Newton's second law gives the torque that the measured acceleration takes,

    T = R ((m + J / R^2) (dv_x/dt - r v_y) + 1/2 rho CdA v_x^2 + c_r m g)

with the wheels' inertia J. Such a torque is no evidence about v_x, which follows it by definition.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.numerics.differentiation import savitzky_golay


def with_inferred_torque(log: SensorLog, parameters: FloatArray) -> SensorLog:
    """Return a recording with the torque that its motion takes; `parameters` (SIZE,)."""
    mass, radius, inertia, drag_area, rolling = (
        float(parameters[INDEX[name]])
        for name in ("mass", "wheel_radius", "wheel_inertia", "drag_area", "rolling")
    )
    period_s = log.odometry_period_s
    even_s = np.arange(log.odometry_s[0], log.odometry_s[-1] + 0.5 * period_s, period_s)
    v_x, v_y, yaw_rate = (
        savitzky_golay(np.interp(even_s, log.odometry_s, column), period_s)
        for column in log.odometry.T
    )
    acceleration = np.gradient(v_x, period_s) - yaw_rate * v_y
    force = (mass + inertia / radius**2) * acceleration
    force += 0.5 * AIR_DENSITY * drag_area * v_x * np.abs(v_x)
    force += rolling * mass * GRAVITY * np.sign(v_x)
    # A command is held until the next one, so that its middle counts.
    held_s = np.diff(log.command_s, append=log.command_s[-1])
    command = log.command.copy()
    command[:, 0] = radius * np.interp(log.command_s + 0.5 * held_s, even_s, force)
    return replace(log, command=command, torque_is_inferred=True)
