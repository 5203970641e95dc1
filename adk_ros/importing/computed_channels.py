# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Channels that no column has, computed from others as the map's `computed` says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.errors import DataError, UsageError
from adk_ros.importing.gps_position import gps_position
from adk_ros.importing.map_file import IDENTIFY, ImportMap, SideslipMap, VelocityMap
from adk_ros.importing.pedal_torque import pedal_torque
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.streams import MessageStream, at_stamps
from adk_ros.importing.wheel_radius import RadiusFit, fit_radius, reference_of
from adk_ros.importing.wheel_velocity import (
    AxleSpeed,
    axle_speed,
    computed_channel,
    direction,
    usual_radius,
    yaw_check,
)
from adk_ros.signals.velocity_messages import estimated_lateral_velocity


def with_computed(
    channels: Sequence[SourceChannel], import_map: ImportMap, map_name: str, notes: list[str]
) -> list[SourceChannel]:
    """
    Return the channels with those that the map computes; lines on how are added to `notes`.

    :raises UsageError: a wheel radius is neither given nor identifiable.
    :raises DataError: wheels never turn at the same time, or a receiver has no fixes.
    """
    given = {channel.name: channel for channel in channels}
    notes += yaw_check(given)
    velocity = import_map.computed.v_x
    if velocity is not None:
        place = f"{map_name}: computed.v_x"
        made = (
            _from_gps(given)
            if velocity.from_ == "gps"
            else _from_wheels(given, velocity, place, notes)
        )
        given["v_x"] = made
    elif "v_x" not in given:
        _suggest(given, notes)
    if import_map.computed.yaw_rate is not None:
        given["odometry_yaw_rate"] = _yaw_rate(given, map_name, notes)
        # No message has a curvature, and the yaw rate has all of it.
        del given["curvature"]
    if import_map.computed.v_y is not None:
        given["v_y_estimated"] = _sideslip(given, import_map.computed.v_y, notes)
    if import_map.computed.position is not None:
        given |= {channel.name: channel for channel in gps_position(given, notes)}
    elif {"latitude", "longitude"} <= given.keys() and not {"x", "y"} & given.keys():
        notes.append("no x, y: compute them with 'computed: {position: {from: gps}}' in the map")
    torque = import_map.computed.torque
    if torque is not None:
        stream, values = pedal_torque(given, torque, notes)
        if not len(stream):
            raise DataError(f"{map_name}: computed.torque: pedals and v_x have no common time")
        source = ", ".join(torque.pedals())
        name = "torque_estimated"
        given[name] = computed_channel(name, source, stream, values)
    return list(given.values())


def _from_gps(given: dict[str, SourceChannel]) -> SourceChannel:
    """Return v_x as the speed over ground: at a sideslip of 5° it is 0.4 % too high."""
    speed = given["gps_speed"]
    stream = MessageStream(speed.stamp_ns, {})
    values = speed.values * direction(given, stream, speed.values)
    return computed_channel("v_x", "gps_speed", stream, values)


def _yaw_rate(given: dict[str, SourceChannel], map_name: str, notes: list[str]) -> SourceChannel:
    """Return the yaw rate of a path of this curvature, at the stamps of v_x."""
    v_x = given["v_x"]
    curvature, known = at_stamps(
        "odometry_yaw_rate", given["curvature"], v_x.stamp_ns, "v_x", notes
    )
    stream = MessageStream(v_x.stamp_ns[known], {})
    if not len(stream):
        raise DataError(f"{map_name}: computed.yaw_rate: curvature and v_x have no common time")
    notes.append(
        "odometry's yaw rate is curvature times v_x: without the rate of the sideslip, unless the "
        "curvature was computed as yaw rate over v_x"
    )
    values = curvature[known] * v_x.values[known]
    return computed_channel("odometry_yaw_rate", "curvature, v_x", stream, values)


def _sideslip(
    given: dict[str, SourceChannel], sideslip: SideslipMap, notes: list[str]
) -> SourceChannel:
    """Return v_y by the steady state of a single-track model, at the stamps of v_x."""
    v_x = given["v_x"]
    rate_of = given.get("yaw_rate") or given["odometry_yaw_rate"]
    rate, known = at_stamps("v_y", rate_of, v_x.stamp_ns, "v_x", [])
    stream = MessageStream(v_x.stamp_ns[known], {})
    if not len(stream):
        raise DataError("computed.v_y: v_x and yaw rate have no common time")
    values = [
        estimated_lateral_velocity(v, r, sideslip.cg_to_rear_axle, sideslip.slip_per_acceleration)
        for v, r in zip(v_x.values[known].tolist(), rate[known].tolist(), strict=True)
    ]
    notes.append(
        "v_y is estimated from v_x and yaw rate: marked as not measured in odometry, and never "
        "scored"
    )
    return computed_channel("v_y_estimated", "v_x, yaw_rate", stream, np.array(values))


def _from_wheels(
    given: dict[str, SourceChannel], velocity: VelocityMap, place: str, notes: list[str]
) -> SourceChannel:
    axle = axle_speed(given, velocity.wheels, notes)
    if len(axle.stream) < 2:
        raise DataError(f"{place}: {', '.join(axle.names)} have no common time")
    fit = _identified(given, axle)
    radius = velocity.wheel_radius
    if radius is None:
        radius = usual_radius(given, axle.names) or IDENTIFY
    source = ", ".join(axle.names)
    if isinstance(radius, str):
        if fit is None:
            raise UsageError(
                f"{place}.wheel_radius: {_why_not(given)}; give the rolling radius in m"
            )
        radius = fit.radius.value
        notes.append(f"v_x from {source}: wheel radius {fit.text}")
    else:
        notes.append(
            f"v_x from {source}: wheel radius {radius:g} m"
            + ("" if fit is None else f"; identified: {fit.text}")
        )
    values = radius * axle.rate * direction(given, axle.stream, axle.rate)
    return computed_channel("v_x", source, axle.stream, np.asarray(values))


def _identified(given: dict[str, SourceChannel], axle: AxleSpeed) -> RadiusFit | None:
    reference = reference_of(given)
    if reference is None:
        return None
    return fit_radius(axle.stream.stamp_ns, axle.rate, reference)


def _why_not(given: dict[str, SourceChannel]) -> str:
    if reference_of(given) is None:
        return "nothing to identify it with: no gps_speed, x and y, or latitude and longitude"
    return "too little driving with wheel speeds and GPS to identify it (30 s are needed)"


def _suggest(given: dict[str, SourceChannel], notes: list[str]) -> None:
    """Say from what v_x can be computed, if it is not."""
    if any(name.startswith("wheel_speed_") for name in given):
        notes.append("no v_x: compute it with 'computed: {v_x: {from: wheel_speeds}}' in the map")
    elif "gps_speed" in given:
        notes.append("no v_x: compute it with 'computed: {v_x: {from: gps}}' in the map")
