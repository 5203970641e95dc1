# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The map of an import: which column is which channel, in which unit, and which one is the time.

A value is stored as `unit(sign * (scale * raw + offset)) / ratio`, in SI units; `offset` is in the
unit of the source, and `ratio` that of a gear between the sensor and the channel, such as the
hand-wheel angle over the road-wheel angle.
"""

from __future__ import annotations

from collections.abc import Collection
from datetime import date, datetime
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, PlainValidator, model_validator

from adk_ros.bags.auxiliary_topics import AXLES
from adk_ros.calibration.pedal_map import ForceTable
from adk_ros.errors import UsageError
from adk_ros.files.yaml_file import FileModel
from adk_ros.importing.channels import CHANNELS, SPEED, is_wheel_speed
from adk_ros.importing.units import factor_to_si, is_unit_of

TIME_UNITS = {
    "ns": 1, "us": 10**3, "µs": 10**3, "ms": 10**6, "s": 10**9, "min": 60 * 10**9,
    "h": 3600 * 10**9, "date": 0,
}  # fmt: skip
"""Unit of a time column -> ns; "date" is a text with date and time."""

_Column = Annotated[str, Field(min_length=1, max_length=400)]
_MAX_RADIUS = 5.0
"""m; the largest `wheel_radius` of a channel."""
IDENTIFY = "identify"
"""In place of a wheel radius: the one that fits GPS speed or position."""


def _radius(value: Any) -> float | str | None:
    """Return a wheel radius as the map gives it; raises `ValueError`."""
    if value is None or value == IDENTIFY:
        return value if value is None else IDENTIFY
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not 0.0 < value <= _MAX_RADIUS:
        raise ValueError(f"give a length up to {_MAX_RADIUS:g} m, or {IDENTIFY}")
    return float(value)


_Radius = Annotated[float | str | None, PlainValidator(_radius)]
_Period = Annotated[float, Field(gt=0.0, le=3600.0)]
_Row = Annotated[int, Field(ge=1)]


class TimeMap(FileModel):
    """
    The time of a file.

    `column`: where it is; None for the clock of an MDF file, CAN log or bag. `origin` is the date,
    or the number of seconds since 1970, at which it is zero; by default the start that the file
    states. `format`: of a date, as strftime writes it. `period`: time between rows, in `unit`, of
    a file that has no time at all; its first row is at zero.
    """

    column: _Column | None = None
    period: _Period | None = None
    unit: str = "s"
    origin: datetime | date | float | str | None = None
    format: str | None = None


def _delimiter(given: Any) -> Any:
    """Return a tab for its name, also in single quotes, where YAML leaves the backslash."""
    return "\t" if given in ("tab", "\\t") else given


class FileMap(FileModel):
    """
    How to read one file, where that differs from the others or is not detected.

    `rows`: first and last row of the table that is read, from 1, without headings: one of several
    drives that the file has in sequence. `every`: of these, only every n-th row is read, without
    an average of the others.
    """

    time: TimeMap | None = None
    rows: Annotated[list[_Row], Field(min_length=2, max_length=2)] | None = None
    every: Annotated[int, Field(ge=1, le=10_000)] = 1
    delimiter: Annotated[str, BeforeValidator(_delimiter), Field(min_length=1, max_length=1)] | (
        None
    ) = None
    decimal: Literal[".", ","] | None = None
    header_row: Annotated[int, Field(ge=1, le=10_000)] | None = None


class ChannelMap(FileModel):
    """The column of a channel and its conversion; `file` where several have such a column."""

    column: _Column
    unit: str
    file: str | None = None
    sign: Literal[1, -1] = 1
    offset: float = 0.0
    scale: float = 1.0
    ratio: float = 1.0
    wheel_radius: Annotated[float, Field(gt=0.0, le=_MAX_RADIUS)] | None = None


class VelocityMap(FileModel):
    """
    How v_x is computed: from wheel speeds, or from the speed over ground of a GPS receiver.

    `wheels`: the undriven axle, which slips least. `wheel_radius` in m, or `IDENTIFY`; by default
    that of the channels, else identified.
    """

    from_: Annotated[Literal["wheel_speeds", "gps"], Field(alias="from")]
    wheels: Literal["front", "rear", "all"] = "all"
    wheel_radius: _Radius = None


class PositionMap(FileModel):
    """How x and y are computed: from the latitude and longitude of a GPS receiver."""

    from_: Annotated[Literal["gps"], Field(alias="from")]


class YawRateMap(FileModel):
    """How odometry's yaw rate is computed: curvature of the path times v_x."""

    from_: Annotated[Literal["curvature"], Field(alias="from")]


class SideslipMap(FileModel):
    """
    How v_y is estimated where it is not measured (`signals.velocity_messages`).

    `cg_to_rear_axle` in m; `slip_per_acceleration`: rear slip angle per lateral acceleration,
    rad s²/m.
    """

    cg_to_rear_axle: Annotated[float, Field(gt=0.0, le=20.0)]
    slip_per_acceleration: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0


_MAX_FORCE = 1e6
"""N; above the brakes of the heaviest lorry."""
_Table = Annotated[list[float], Field(min_length=1, max_length=100)]


def _is_number(value: Any) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) <= _MAX_FORCE


class ForceMap(FileModel):
    """
    Force of a pedal, N, as `adk check` proposes it: interpolated, and constant beyond its ends.

    `pedal`: positions, ascending, in the SI unit of its channel. `force`: of each position, or a
    row for each `speed` (m/s, ascending) or `gear`.
    """

    pedal: _Table
    speed: _Table | None = None
    gear: _Table | None = None
    force: Annotated[list[Any], Field(min_length=1, max_length=100)]

    @model_validator(mode="after")
    def _has_rows(self) -> ForceMap:
        """Raise `ValueError` if the table has holes."""
        if self.speed is not None and self.gear is not None:
            raise ValueError("give speed or gear, not both")
        for name, scale in (("pedal", self.pedal), ("speed", self.speed), ("gear", self.gear)):
            if scale is not None and any(b <= a for a, b in pairwise(scale)):
                raise ValueError(f"{name} must ascend")
        at = self.speed or self.gear
        nested = [row for row in self.force if isinstance(row, list)]
        if len(nested) != (0 if at is None else len(at)):
            raise ValueError("force needs a row for each speed or gear, and else one list")
        rows = nested or [self.force]
        if any(len(row) != len(self.pedal) or not all(map(_is_number, row)) for row in rows):
            raise ValueError("force needs a number for each position of the pedal")
        return self

    def table(self) -> ForceTable:
        """Return the table for interpolation."""
        at = self.speed or self.gear
        return ForceTable(
            np.array(self.pedal),
            np.atleast_2d(np.array(self.force, dtype=np.float64)),
            "" if at is None else "speed" if self.speed else "gear",
            None if at is None else np.array(at),
        )


class TorqueMap(FileModel):
    """How the wheel torque is estimated from pedals: `wheel_radius` in m times their forces."""

    from_: Annotated[Literal["pedals"], Field(alias="from")]
    wheel_radius: Annotated[float, Field(gt=0.0, le=_MAX_RADIUS)]
    throttle: ForceMap | None = None
    brake_pedal: ForceMap | None = None
    brake_pressure: ForceMap | None = None

    def pedals(self) -> dict[str, ForceMap]:
        """Return the pedals that the map has, by channel."""
        names = ("throttle", "brake_pedal", "brake_pressure")
        found = {name: getattr(self, name) for name in names}
        return {name: entry for name, entry in found.items() if entry is not None}


class ComputedMap(FileModel):
    """Channels that no column has, computed from others."""

    v_x: VelocityMap | None = None
    v_y: SideslipMap | None = None
    yaw_rate: YawRateMap | None = None
    torque: TorqueMap | None = None
    position: PositionMap | None = None


class ImportMap(FileModel):
    """The content of a map file."""

    time: TimeMap | None = None
    files: dict[str, FileMap] = Field(default_factory=dict)
    channels: dict[str, ChannelMap]
    computed: ComputedMap = ComputedMap()


def axles_of(wheels: str) -> tuple[str, ...]:
    """Return the axles that `VelocityMap.wheels` stands for."""
    return tuple(AXLES) if wheels == "all" else (wheels,)


def wheels_of(axle: str, names: Collection[str]) -> tuple[str, ...]:
    """Return the wheel-speed channels of an axle: its wheels, else its mean; empty if none."""
    pair = tuple(f"wheel_speed_{at}" for at in AXLES[axle] if f"wheel_speed_{at}" in names)
    mean = f"wheel_speed_{axle}"
    return (mean,) if mean in names and len(pair) < len(AXLES[axle]) else pair


def factor_of(channel: str, entry: ChannelMap) -> float:
    """
    Return the factor from a source's unit to the channel's SI unit.

    :raises UsageError: the unit does not fit, or a wheel speed in m/s lacks its radius.
    """
    si = CHANNELS[channel].unit
    if is_wheel_speed(channel):
        if is_unit_of(entry.unit, SPEED):
            if entry.wheel_radius is None:
                raise UsageError(
                    f"a wheel speed in '{entry.unit}' needs wheel_radius in m, or map it in rpm"
                )
            return factor_to_si(entry.unit, SPEED) / entry.wheel_radius
    elif entry.wheel_radius is not None:
        raise UsageError(f"wheel_radius is for wheel speeds only, not for {channel}")
    return factor_to_si(entry.unit, si)
