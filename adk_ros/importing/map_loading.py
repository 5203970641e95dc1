# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read a map and check what its entries need of each other, before any file is read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from adk_ros.errors import UsageError
from adk_ros.files.yaml_file import read, validate
from adk_ros.importing.channels import CHANNELS
from adk_ros.importing.map_file import (
    TIME_UNITS,
    ImportMap,
    TorqueMap,
    VelocityMap,
    axles_of,
    factor_of,
    wheels_of,
)


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
    _check_computed(name, loaded)
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


def _check_computed(name: str, loaded: ImportMap) -> None:
    """Raise `UsageError` if a channel has two sources, or a computed one lacks what it needs."""
    if {"torque", "torque_estimated"} <= loaded.channels.keys():
        raise UsageError(f"{name}: channels: give torque or torque_estimated, not both")
    if loaded.computed.v_x is not None:
        _check_velocity(name, loaded, loaded.computed.v_x)
    if loaded.computed.v_y is not None:
        _check_sideslip(name, loaded)
    _check_yaw_rate(name, loaded)
    if loaded.computed.torque is not None:
        _check_torque(name, loaded, loaded.computed.torque)
    if loaded.computed.position is not None:
        _check_position(name, loaded)


def _check_position(name: str, loaded: ImportMap) -> None:
    place = f"{name}: computed.position"
    for other in ("x", "y"):
        if other in loaded.channels:
            raise UsageError(f"{place}: channels.{other} is given as well: leave out one of them")
    for needed in ("latitude", "longitude"):
        if needed not in loaded.channels:
            raise UsageError(f"{place}: needs channels.{needed}")
    if "v_x" not in loaded.channels and loaded.computed.v_x is None:
        raise UsageError(f"{place}: needs v_x, in channels or computed")


def _check_yaw_rate(name: str, loaded: ImportMap) -> None:
    place = f"{name}: computed.yaw_rate"
    if loaded.computed.yaw_rate is None:
        if "curvature" in loaded.channels:
            raise UsageError(f"{place}: channels.curvature needs 'yaw_rate: {{from: curvature}}'")
        return
    if "odometry_yaw_rate" in loaded.channels:
        raise UsageError(
            f"{place}: channels.odometry_yaw_rate is given as well: leave out one of them"
        )
    if "curvature" not in loaded.channels:
        raise UsageError(f"{place}: needs channels.curvature")
    if "v_x" not in loaded.channels and loaded.computed.v_x is None:
        raise UsageError(f"{place}: needs v_x, in channels or computed")


def _check_sideslip(name: str, loaded: ImportMap) -> None:
    place = f"{name}: computed.v_y"
    for other in ("v_y", "v_y_estimated"):
        if other in loaded.channels:
            raise UsageError(f"{place}: channels.{other} is given as well: leave out one of them")
    if "v_x" not in loaded.channels and loaded.computed.v_x is None:
        raise UsageError(f"{place}: needs v_x, in channels or computed")
    has_rate = bool({"yaw_rate", "odometry_yaw_rate"} & loaded.channels.keys())
    if not has_rate and loaded.computed.yaw_rate is None:
        raise UsageError(f"{place}: needs channels.yaw_rate")


def _check_torque(name: str, loaded: ImportMap, torque: TorqueMap) -> None:
    place = f"{name}: computed.torque"
    for other in ("torque", "torque_estimated"):
        if other in loaded.channels:
            raise UsageError(f"{place}: channels.{other} is given as well: leave out one of them")
    pedals = torque.pedals()
    if not pedals:
        raise UsageError(f"{place}: give throttle, brake_pedal or brake_pressure")
    if len(pedals) == 3:
        raise UsageError(f"{place}: give brake_pedal or brake_pressure, not both")
    has_v_x = "v_x" in loaded.channels or loaded.computed.v_x is not None
    needed = {*pedals} | {"gear" for entry in pedals.values() if entry.gear}
    missing = sorted(needed - loaded.channels.keys())
    if missing:
        raise UsageError(f"{place}: needs channels.{missing[0]}")
    if not has_v_x:
        raise UsageError(f"{place}: needs v_x, in channels or computed")


def _check_velocity(name: str, loaded: ImportMap, velocity: VelocityMap) -> None:
    place = f"{name}: computed.v_x"
    if "v_x" in loaded.channels:
        raise UsageError(f"{place}: channels.v_x is given as well: leave out one of them")
    if velocity.from_ == "gps":
        if "gps_speed" not in loaded.channels:
            raise UsageError(f"{place}: needs channels.gps_speed")
        if velocity.wheel_radius is not None or velocity.wheels != "all":
            raise UsageError(f"{place}: wheels and wheel_radius are for 'from: wheel_speeds'")
        return
    if not any(wheels_of(axle, loaded.channels) for axle in axles_of(velocity.wheels)):
        which = "" if velocity.wheels == "all" else f"{velocity.wheels} "
        raise UsageError(
            f"{place}: needs {which}wheel speeds in channels, such as "
            f"wheel_speed_{axles_of(velocity.wheels)[0]}_left"
        )


def _closest(name: str) -> str:
    import difflib

    close = difflib.get_close_matches(name, CHANNELS, n=1)
    return f"; did you mean {close[0]}?" if close else f": choose one of {', '.join(CHANNELS)}"
