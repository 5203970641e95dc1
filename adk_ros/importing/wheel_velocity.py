# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Longitudinal velocity from the speeds of the wheels.

The wheels of an axle run at the mean v_x / R in bends as well; front wheels that are turned by
delta roll in their direction, so that v_x = R omega cos(delta) at small slip angles. Slip of
driven wheels is not removed: take the undriven axle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from adk_ros.bags.auxiliary_topics import AXLES
from adk_ros.calibration.regression import regress
from adk_ros.importing.channels import CHANNELS
from adk_ros.importing.map_file import ChannelMap, axles_of, wheels_of
from adk_ros.importing.source_channels import COMPUTED, SourceChannel
from adk_ros.importing.streams import MessageStream, at_stamps, joined, rate_hz
from adk_ros.numerics.arrays import FloatArray


class AxleSpeed(NamedTuple):
    """Rolling speed of wheels as one: stamps (n,), ns, rate (n,), rad/s, and the wheels used."""

    stream: MessageStream
    rate: FloatArray
    names: tuple[str, ...]


def axle_speed(given: Mapping[str, SourceChannel], wheels: str, notes: list[str]) -> AxleSpeed:
    """
    Return the speed of the wheels of an axle, or of both, with their steering angle removed.

    :param wheels: "front", "rear" or "all"; at least one of these wheels is given.
    """
    axles = {axle: names for axle in axles_of(wheels) if (names := wheels_of(axle, given))}
    names = tuple(name for group in axles.values() for name in group)
    stream = joined("wheel speeds", [given[name] for name in names], notes)
    rates = []
    for axle, group in axles.items():
        rate = np.mean([stream.values[name] for name in group], axis=0)
        if axle == "front" and "delta" in given:
            delta, known = at_stamps("v_x", given["delta"], stream.stamp_ns, names[0], [])
            rate = rate * np.cos(np.where(known, delta, 0.0))
        rates.append(rate)
        is_single = len(group) == 1 and group[0] != f"wheel_speed_{axle}"
        if is_single:
            notes.append(
                f"v_x: of the {axle} wheels only {group[0]} is given: in bends v_x is off by half "
                "the track times the yaw rate"
            )
    if "front" in axles and "delta" not in given:
        notes.append("v_x: front wheels without delta: in bends they run ahead by 1 / cos(delta)")
    return AxleSpeed(stream, np.mean(rates, axis=0), names)


def direction(
    given: Mapping[str, SourceChannel], stream: MessageStream, speed: FloatArray
) -> FloatArray:
    """Return -1 (n,) where the gear is reverse and the speed is unsigned, else 1."""
    if "gear" not in given or bool((speed < 0.0).any()):
        return np.ones_like(speed)
    gear = given["gear"]
    before = np.searchsorted(gear.stamp_ns, stream.stamp_ns, side="right") - 1
    held = gear.values[np.maximum(before, 0)]
    return np.where((held < 0.0) & (before >= 0), -1.0, 1.0)


def yaw_check(given: Mapping[str, SourceChannel]) -> list[str]:
    """
    Return what the difference of left and right wheels says of the gyro, one line per axle.

    v_right - v_left = track * yaw rate + difference of the radii / R * v + offset of the gyro;
    regressed in rad/s times the radius that the map states, or per metre of radius without one.
    """
    lines = []
    for axle, pair in AXLES.items():
        names = [f"wheel_speed_{at}" for at in pair]
        if "yaw_rate" not in given or not set(names) <= set(given):
            continue
        stream = joined(axle, [given[name] for name in names], [])
        if len(stream) < 2:
            continue
        rate, known = at_stamps(axle, given["yaw_rate"], stream.stamp_ns, names[0], [])
        left, right = (stream.values[name] for name in names)
        mean = 0.5 * (left + right)
        columns = np.column_stack([rate, mean, np.ones_like(mean)])
        weights = (known & (left > 0.0) & (right > 0.0)).astype(np.float64)
        fit = regress(columns, right - left, weights, period_s=1.0 / rate_hz(stream.stamp_ns))
        if fit is None:
            continue
        # Track over wheel radius: without a radius, its sign alone says something.
        track, radii = fit.estimate(0), fit.estimate(1)
        if track.high < 0.0:
            lines.append(
                f"{axle} wheels: the right one turns slower in left turns: left and right are "
                "swapped, or the sign of yaw_rate is wrong"
            )
        elif track.low > 0.0:
            lines.append(
                f"{axle} wheels agree with yaw_rate: track / wheel radius {track.value:.2f} "
                f"({track.low:.2f} to {track.high:.2f}); the right one turns "
                f"{100.0 * radii.value:+.2f} % faster ({100.0 * radii.low:+.2f} to "
                f"{100.0 * radii.high:+.2f} %)"
            )
    return lines


def computed_channel(
    name: str, source: str, stream: MessageStream, values: FloatArray
) -> SourceChannel:
    """Return a channel in SI units that was computed from others, as if a column had it."""
    unit = CHANNELS[name].unit
    entry = ChannelMap(column=source, unit=unit)
    return SourceChannel(name, COMPUTED, source, entry, 1.0, stream.stamp_ns, values, 0, 0, 0)


def usual_radius(given: Mapping[str, SourceChannel], names: Sequence[str]) -> float | None:
    """Return the wheel radius that the map states for all of these wheels; None if it does not."""
    radii = {given[name].entry.wheel_radius for name in names}
    (radius,) = radii if len(radii) == 1 else (None,)
    return radius
