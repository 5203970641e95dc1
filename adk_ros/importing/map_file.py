# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The map of an import: which column is which channel, in which unit, and which one is the time.

A value is stored as `unit(sign * (scale * raw + offset)) / ratio`, in SI units; `offset` is in the
unit of the source, and `ratio` that of a gear between the sensor and the channel, such as the
hand-wheel angle over the road-wheel angle.
"""

from __future__ import annotations

from datetime import date, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from adk_ros.errors import UsageError
from adk_ros.files.yaml_file import FileModel, read, validate
from adk_ros.importing.channels import CHANNELS, SPEED, is_wheel_speed
from adk_ros.importing.units import factor_to_si, is_unit_of

TIME_UNITS = {
    "ns": 1, "us": 10**3, "µs": 10**3, "ms": 10**6, "s": 10**9, "min": 60 * 10**9,
    "h": 3600 * 10**9, "date": 0,
}  # fmt: skip
"""Unit of a time column -> ns; "date" is a text with date and time."""

_Column = Annotated[str, Field(min_length=1, max_length=400)]
_Length = Annotated[float, Field(gt=0.0, le=5.0)]
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


class FileMap(FileModel):
    """
    How to read one file, where that differs from the others or is not detected.

    `rows`: first and last row of the table that is read, from 1, without headings: one of several
    drives that the file has in sequence.
    """

    time: TimeMap | None = None
    rows: Annotated[list[_Row], Field(min_length=2, max_length=2)] | None = None
    delimiter: str | None = None
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
    wheel_radius: _Length | None = None


class ImportMap(FileModel):
    """The content of a map file."""

    time: TimeMap | None = None
    files: dict[str, FileMap] = Field(default_factory=dict)
    channels: dict[str, ChannelMap]


def load_map(path: Path | str) -> ImportMap:
    """
    Return the map of a YAML file.

    :raises UsageError: it cannot be read, or a key, channel, unit or number is wrong; the message
        names the file and the place.
    """
    if not Path(path).suffix:
        raise UsageError(f"{path}: give a YAML file, such as map.yaml")
    return checked_map(*read(path, "map"))


def checked_map(name: str, content: Any) -> ImportMap:
    """
    Return a map's content, checked.

    :param name: of the file, for messages.
    :raises UsageError: as `load_map`.
    """
    loaded = validate(name, content, ImportMap)
    if not loaded.channels:
        raise UsageError(f"{name}: channels: name at least one channel")
    for channel, entry in loaded.channels.items():
        place = f"{name}: channels.{channel}"
        if channel not in CHANNELS:
            raise UsageError(f"{place}: no such channel{_closest(channel)}")
        if entry.scale == 0.0 or entry.ratio == 0.0:
            raise UsageError(f"{place}: scale and ratio must not be 0")
        try:
            factor_of(channel, entry)
        except UsageError as error:
            raise UsageError(f"{place}.unit: {error}") from None
    places = [("time", loaded.time)]
    places += [(f"files.{key}.time", item.time) for key, item in loaded.files.items()]
    for place, time in places:
        if time is None:
            continue
        if time.unit not in TIME_UNITS:
            known = ", ".join(TIME_UNITS)
            raise UsageError(
                f"{name}: {place}.unit: unit '{time.unit}' is unknown: choose one of {known}"
            )
        if time.period is not None and (time.column is not None or time.unit == "date"):
            raise UsageError(f"{name}: {place}.period: needs a unit, and no column")
    for key, item in loaded.files.items():
        if item.rows is not None and item.rows[0] >= item.rows[1]:
            raise UsageError(f"{name}: files.{key}.rows: give the first and the last row")
    return loaded


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


def _closest(name: str) -> str:
    import difflib

    close = difflib.get_close_matches(name, CHANNELS, n=1)
    return f"; did you mean {close[0]}?" if close else f": choose one of {', '.join(CHANNELS)}"
