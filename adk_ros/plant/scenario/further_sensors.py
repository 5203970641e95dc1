# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sensors of a vehicle beside IMU, odometry and command: attitude and speeds of the wheels.

Their noise comes from generators of their own, so that the other streams of a drive are the same
with and without them.
"""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.environment.road import ROAD_BANK, ROAD_GRADE, Route, lookup
from adk_ros.plant.scenario.sensors import Imu, Stream, Wheels, send, stamps
from adk_ros.plant.vehicle import fourteen_dof
from adk_ros.plant.vehicle.seven_dof import OMEGA
from adk_ros.signals.channels import TICK_NS

_ATTITUDE, _WHEELS = 1, 2
"""Keys of the random generators."""


def attitude_stream(
    seed: int, imu: Imu, stream: Stream, route: Route, distance: FloatArray, states: FloatArray
) -> Stream:
    """
    Return roll and pitch (m, 2), rad, at the stamps of the IMU's messages (`stream`).

    REP-103: right side down and nose down are positive. Of a vehicle with a sprung mass they are
    those of the body, else those of the road.

    :param distance: arc length (n,) along the route at each tick, m. :param states: of the plant.
    """
    if states.shape[1] == fourteen_dof.STATE_SIZE:
        angles = states[:, [fourteen_dof.ROLL, fourteen_dof.PITCH]]
    else:
        table, spacing = route.table, route.spacing
        angles = np.array(
            [
                [lookup(table, spacing, s, ROAD_BANK), -lookup(table, spacing, s, ROAD_GRADE)]
                for s in distance.tolist()
            ]
        )
    rng = np.random.default_rng([seed, _ATTITUDE])
    values = _at(angles, stream.stamp_ns) + np.array([imu.bias_roll, imu.bias_pitch])
    values += (imu.attitude_noise or 0.0) * rng.standard_normal(values.shape)
    return Stream(stream.stamp_ns, stream.log_ns, values)


def wheel_stream(seed: int, wheels: Wheels, seconds: float, states: FloatArray) -> Stream:
    """Return the speeds (m, 4) of the wheels, rad/s: front left, front right, rear left, right."""
    at = stamps(wheels, seconds)
    speeds = _at(states[:, OMEGA : OMEGA + 4], at)
    rng = np.random.default_rng([seed, _WHEELS])
    noise, step = [wheels.speed_noise] * 4, [wheels.speed_resolution] * 4
    return send(rng, wheels, at, speeds, noise, [0.0] * 4, step)


def _at(rows: FloatArray, at_ns: IntArray) -> FloatArray:
    """Interpolate values on the ticks (n, k) at times from the start, ns: (m, k)."""
    grid = np.arange(rows.shape[0], dtype=np.float64) * TICK_NS
    return np.column_stack([np.interp(at_ns, grid, column) for column in rows.T])
