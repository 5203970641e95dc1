# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which auxiliary channel of a recording can take the place of a missing one, and how."""

from __future__ import annotations

from collections.abc import Iterable

from adk_ros.bags.auxiliary_topics import PEDALS
from adk_ros.calibration.streams import Stream, Streams


def of_pedals(streams: Streams) -> str:
    """Return how to make a torque of the pedals, as the end of a sentence; empty without any."""
    names = [
        name
        for name in PEDALS
        if name != "gear" and name in streams.pedals and streams.pedals[name].has("value")
    ]
    if not names:
        return ""
    return (
        f", but pedals are recorded ({', '.join(names)}): `adk check --vehicle` makes a torque of "
        "them"
    )


def of_speeds(streams: Streams) -> str:
    """Return how to make v_x of wheel speeds or GPS speed; empty without any."""
    if _any_varies([*streams.wheel_speeds.values(), *streams.wheels.values()], "velocity"):
        return (
            ", but wheel speeds are recorded: set wheel_radius in --params, or import again with "
            "computed v_x"
        )
    if streams.gps_speed is not None and streams.gps_speed.has("gps_speed"):
        return ", but a GPS speed is recorded: import again with computed v_x from gps"
    return ""


def of_positions(streams: Streams) -> str:
    """Return that GPS positions are recorded; empty if they are not."""
    fix = streams.gps_fix
    if fix is None or not (fix.has("latitude") and fix.has("longitude")):
        return ""
    return "; of the GPS positions that are recorded no pose is made"


def _any_varies(streams: Iterable[Stream], column: str) -> bool:
    return any(stream.has(column) for stream in streams)
