# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The named channels of a vehicle and the three shapes they travel in.

A `Reading` is what one message says, a `Sample` what is known on one tick of the 25 ms grid, a
`Record` a whole drive of samples. SI units and radians throughout; REP-103 axes: x forward, y
left, z up. Accelerations are specific force: what an accelerometer senses, gravity not removed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import NamedTuple

import numpy as np

from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

TICK_NS = 25_000_000
"""Grid spacing in nanoseconds: the method's 25 ms."""

STATE_NAMES = ("v_x", "v_y", "yaw_rate")
STATE_UNITS = ("m/s", "m/s", "rad/s")
INPUT_NAMES = ("torque", "delta")
INPUT_UNITS = ("N m", "rad")


class Source(IntEnum):
    """Which stream a reading came from; the value indexes per-stream tables."""

    IMU = 0
    ODOMETRY = 1
    COMMAND = 2
    STEERING = 3
    """Measured road-wheel angle, where a command carries only the wished one (Autoware)."""


STANDARD_SOURCES = (Source.IMU, Source.ODOMETRY, Source.COMMAND)
"""The streams of any drive; a measured steering angle is for commands that need one."""


class Reading(NamedTuple):
    """
    One message's content at the vehicle's reference point.

    `values` by source: IMU (a_x, a_y, yaw_rate), ODOMETRY (v_x, v_y, yaw_rate), COMMAND (torque,
    delta), STEERING (delta,). A channel that the message does not report is NaN.
    """

    source: Source
    stamp_ns: int
    values: tuple[float, ...]


class Flag(IntFlag):
    """Why a sample is not as good as it should be; zero is a sample that may be learned from."""

    OK = 0
    NO_IMU = 1
    """All comes from odometry; not a fault where there never was an IMU."""
    IMU_STALE = 2
    """An IMU that was there fell silent."""
    ODOMETRY_STALE = 4
    """No odometry for longer than it usually takes: velocities are dead-reckoned or missing."""
    COMMAND_STALE = 8
    """No command for longer than it usually takes: the last one is held."""
    FROZEN = 16
    """A sensor repeats one value to the last bit while the vehicle must be changing."""
    COASTING = 32
    """No usable state: the caller supplies one, or nothing is predicted."""
    RESTART = 64
    """First sample after a start or a jump of the clock: the past does not belong to it."""


UNLEARNABLE = (
    Flag.IMU_STALE | Flag.ODOMETRY_STALE | Flag.COMMAND_STALE | Flag.FROZEN | Flag.COASTING
)
"""A sample with any of these must not enter a fit."""


class Sample(NamedTuple):
    """
    What is known at one tick, from readings stamped at or before it alone.

    `stamp_ns` is a multiple of 25 ms of header time. `x` = (v_x, v_y, yaw_rate), `u` = (torque,
    delta) in force from this tick on, `a` = (a_x, a_y), NaN where there is no IMU.
    """

    stamp_ns: int
    x: tuple[float, float, float]
    u: tuple[float, float]
    a: tuple[float, float]
    flags: int

    @property
    def learnable(self) -> bool:
        """Whether this sample may enter a least-squares window."""
        return not int(self.flags) & int(UNLEARNABLE)


@dataclass(frozen=True)
class Record:
    """
    A drive on the grid: `n` samples, one row a tick, in time order.

    `x` (n, 3), `u` (n, 2), `a` (n, 2), `flags` (n,) as in `Sample`. `x_ref` (n, 3) is the
    measurement at the tick with hindsight: interpolated between the readings on both sides of it,
    NaN where a gap is too wide. Predictions are scored, and networks trained, against `x_ref`;
    they start from `x`. `episode` (n,) numbers the stretches without a break in the grid.
    """

    stamp_ns: IntArray
    x: FloatArray
    u: FloatArray
    a: FloatArray
    flags: IntArray
    x_ref: FloatArray
    episode: IntArray
    name: str = ""

    def __len__(self) -> int:
        return int(self.stamp_ns.shape[0])

    @property
    def learnable(self) -> BoolArray:
        """Rows that may enter a fit, shape (n,)."""
        return np.asarray((self.flags & int(UNLEARNABLE)) == 0)

    @property
    def duration_s(self) -> float:
        """Seconds of samples, breaks not counted."""
        return len(self) * TICK_NS * 1e-9

    def rows(self, keep: slice | BoolArray | IntArray) -> Record:
        """Return the chosen rows as a record of their own (episodes keep their numbers)."""
        return Record(
            self.stamp_ns[keep],
            self.x[keep],
            self.u[keep],
            self.a[keep],
            self.flags[keep],
            self.x_ref[keep],
            self.episode[keep],
            self.name,
        )
