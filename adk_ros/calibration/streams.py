# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The streams of a recording at their own rates, with all axes, before any correction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from adk_ros.numerics.arrays import FloatArray

IMU_COLUMNS = ("a_x", "a_y", "a_z", "w_x", "w_y", "w_z")
ODOMETRY_COLUMNS = ("v_x", "v_y", "yaw_rate", "x", "y", "heading")
COMMAND_COLUMNS = ("torque", "steering")


@dataclass(frozen=True)
class Stream:
    """
    Messages of one sensor, sorted by stamp.

    `name` for messages to users, `at_s` (n,): stamps, s from the first of all streams;
    `columns`: values (n,) by name, SI; a channel that is not reported is NaN throughout.
    `disordered`: messages whose stamp was not later than the one before. `unknown`: intervals, s,
    in which a channel that is otherwise reported has no value.
    """

    name: str
    at_s: FloatArray
    columns: Mapping[str, FloatArray]
    disordered: int = 0
    unknown: tuple[tuple[float, float], ...] = ()

    def __getitem__(self, column: str) -> FloatArray:
        return self.columns[column]

    def has(self, column: str) -> bool:
        """Whether a channel is reported and varies."""
        values = self.columns.get(column)
        return (
            values is not None
            and bool(np.isfinite(values).all())
            and values.size > 1
            and float(np.ptp(values)) > 0.0
        )

    def having(self, **columns: FloatArray) -> Stream:
        """Return the stream with other values in some columns."""
        return replace(self, columns={**self.columns, **columns})

    @property
    def period_s(self) -> float:
        """Median time between messages, s."""
        return float(np.median(np.diff(self.at_s))) if self.at_s.size > 1 else float("inf")


@dataclass(frozen=True)
class Streams:
    """
    The streams of a recording; None where it has no such stream.

    `wheels`: angular velocities (n,) of joints, rad/s, by joint name. `notes`: what was done
    while reading, for the person. `attitude`: roll and pitch, rad, of an inertial navigation
    system, as far as the IMU or odometry reports them; no check depends on it. `pedals`: throttle,
    brake_pedal, brake_pressure (Pa) and gear in the column "value", as far as they are recorded.
    `wheel_speeds`: angular velocities in the column "velocity", rad/s, by the position of a wheel
    or axle, such as `front_left`. `gps_speed`: speed over ground in the column of that name, m/s,
    and, where the receiver reports a velocity, its direction `gps_course`, rad, clockwise from
    north; `gps_fix`: latitude and longitude, degrees. `heights`: height in the column "height", m,
    by its source, "odometry" or "gps", as far as it varies.
    """

    name: str
    seconds: float
    imu: Stream | None
    odometry: Stream | None
    command: Stream | None
    wheels: Mapping[str, Stream] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    attitude: Stream | None = None
    pedals: Mapping[str, Stream] = field(default_factory=dict)
    wheel_speeds: Mapping[str, Stream] = field(default_factory=dict)
    gps_speed: Stream | None = None
    gps_fix: Stream | None = None
    heights: Mapping[str, Stream] = field(default_factory=dict)

    def of(self, name: str) -> Stream | None:
        """Return the stream "imu", "odometry" or "command", None if it does not exist."""
        found: Stream | None = getattr(self, name)
        return found

    def with_stream(self, name: str, stream: Stream) -> Streams:
        """Return the streams with another one in place of "imu", "odometry" or "command"."""
        changes: dict[str, Any] = {name: stream}
        return replace(self, **changes)

    def present(self) -> list[Stream]:
        """Return the streams that exist: IMU, odometry, command."""
        return [x for x in (self.imu, self.odometry, self.command) if x is not None]
