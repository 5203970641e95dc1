# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The named channels of a vehicle, and the three types that carry them.

A `Reading` is the content of one message, a `Sample` the known values at one tick of the 25 ms
grid, a `Record` all samples of a recording. SI units and radians; REP-103 axes: x forward, y
left, z up. Accelerations are specific force: accelerometer readings, gravity not removed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import NamedTuple

import numpy as np

from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

TICK_NS = 25_000_000
"""Sample period, ns: 25 ms, the period of the published method."""

STATE_NAMES = ("v_x", "v_y", "yaw_rate")
STATE_UNITS = ("m/s", "m/s", "rad/s")
INPUT_NAMES = ("torque", "delta")
INPUT_UNITS = ("N m", "rad")


class Source(IntEnum):
    """Stream of a reading; the value indexes per-stream tables."""

    IMU = 0
    ODOMETRY = 1
    COMMAND = 2
    STEERING = 3
    """Measured road-wheel angle, published next to the commanded one (Autoware)."""


STANDARD_SOURCES = (Source.IMU, Source.ODOMETRY, Source.COMMAND)
"""Streams of every recording; STEERING exists only for some command types."""


class Reading(NamedTuple):
    """
    Content of one message, at the vehicle's reference point.

    `values` by source: IMU (a_x, a_y, yaw_rate), ODOMETRY (v_x, v_y, yaw_rate), COMMAND (torque,
    delta), STEERING (delta,). A channel that the message does not report is NaN. `variances`: of
    `values`, as the message reports them, None if it does not.
    """

    source: Source
    stamp_ns: int
    values: tuple[float, ...]
    variances: tuple[float, ...] | None = None


class Flag(IntFlag):
    """Defects of a sample; a sample with `OK` may enter a fit."""

    OK = 0
    NO_IMU = 1
    """State from odometry only, also an `odometry_timeout_s` after the last IMU reading."""
    IMU_STALE = 2
    """No IMU reading for longer than three of its periods."""
    ODOMETRY_STALE = 4
    """No odometry for longer than three of its periods: dead-reckoned or missing velocities."""
    COMMAND_STALE = 8
    """No command for longer than three of its periods: the last one is held."""
    FROZEN = 16
    """A sensor repeats bit-identical values although the vehicle moves."""
    COASTING = 32
    """No measured state: the caller substitutes a predicted state, or makes no prediction."""
    RESTART = 64
    """First sample after a start or a clock jump: earlier samples are not its past."""
    REJECTED = 128
    """The gate rejected a reading of this tick."""
    LEVEL_CHANGE = 256
    """The gate accepted a new level: the state is not a continuation of its past."""


UNLEARNABLE = (
    Flag.IMU_STALE
    | Flag.ODOMETRY_STALE
    | Flag.COMMAND_STALE
    | Flag.FROZEN
    | Flag.COASTING
    | Flag.REJECTED
    | Flag.LEVEL_CHANGE
)
"""Flags that exclude a sample from every fit."""


class Sample(NamedTuple):
    """
    Known values at one tick, from readings stamped at or before it (causal).

    `stamp_ns` is a multiple of 25 ms in header time. `x` = (v_x, v_y, yaw_rate), `u` = (torque,
    delta) in force from this tick on, `a` = (a_x, a_y), NaN without an IMU.
    """

    stamp_ns: int
    x: tuple[float, float, float]
    u: tuple[float, float]
    a: tuple[float, float]
    flags: int

    @property
    def learnable(self) -> bool:
        """Whether this sample may enter a fit."""
        return not int(self.flags) & int(UNLEARNABLE)


@dataclass(frozen=True)
class Record:
    """
    A recording as `n` samples, one row per tick, in time order.

    `x` (n, 3), `u` (n, 2), `a` (n, 2), `flags` (n,) as in `Sample`. `x_ref` (n, 3) is the
    non-causal (two-sided) reference measurement: interpolated between the readings on both sides
    of the tick, NaN where the gap is too wide. Predictions start from `x`; they are scored, and
    networks trained, against `x_ref`. `episode` (n,) numbers the segments without a gap.
    `estimated`: states that are estimates, not measurements; they are never scored.
    """

    stamp_ns: IntArray
    x: FloatArray
    u: FloatArray
    a: FloatArray
    flags: IntArray
    x_ref: FloatArray
    episode: IntArray
    name: str = ""
    estimated: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.stamp_ns.shape[0])

    @property
    def learnable(self) -> BoolArray:
        """Whether each row may enter a fit, shape (n,)."""
        return np.asarray((self.flags & int(UNLEARNABLE)) == 0)

    @property
    def measured(self) -> BoolArray:
        """Whether each state is measured (3,): no estimate, and its reference not constant."""
        known = self.x_ref[np.isfinite(self.x_ref).all(axis=1)]
        varies = np.ptp(known, axis=0) > 0.0 if len(known) else np.ones(3, dtype=bool)
        return np.asarray(varies & ~np.isin(STATE_NAMES, self.estimated))

    @property
    def duration_s(self) -> float:
        """Total duration of the samples, gaps excluded, s."""
        return len(self) * TICK_NS * 1e-9

    def rows(self, keep: slice | BoolArray | IntArray) -> Record:
        """Return the chosen rows as a new record; episodes keep their numbers."""
        return Record(
            self.stamp_ns[keep],
            self.x[keep],
            self.u[keep],
            self.a[keep],
            self.flags[keep],
            self.x_ref[keep],
            self.episode[keep],
            self.name,
            self.estimated,
        )
