# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Choose from what v_x is computed where no column has it: wheel speeds, or a GPS receiver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from adk_ros.bags.auxiliary_topics import AXLES
from adk_ros.calibration.regression import regress
from adk_ros.importing.channels import RATE, SPEED, is_wheel_speed
from adk_ros.importing.map_file import IDENTIFY, wheels_of
from adk_ros.importing.map_text import Guess
from adk_ros.importing.relations import STEP_S, at_grid
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.units import factor_to_si, is_unit_of
from adk_ros.importing.wheel_radius import reference_of
from adk_ros.numerics.arrays import FloatArray

USUAL_RADIUS = 0.3
"""m; of the wheels of a passenger car within 20 %, a guess to be checked."""
_MIN_SPEED = 0.15
"""Share of the top speed above which the wheels of two axles are compared."""


def speed_to_compare(
    channels: Mapping[str, SourceChannel], known: Mapping[str, str]
) -> tuple[SourceChannel, str] | None:
    """
    Return a speed that stands in for a missing v_x when units are chosen, and its unit.

    The unit is empty if it is not known. None without GPS speed and wheel speeds of known unit.
    """
    if "gps_speed" in channels:
        return replace(channels["gps_speed"], name="v_x"), known.get("gps_speed", "")
    for name, channel in channels.items():
        unit = known.get(name, "")
        if not is_wheel_speed(name) or not unit:
            continue
        if is_unit_of(unit, SPEED):
            return replace(channel, name="v_x"), unit
        values = channel.values * factor_to_si(unit, RATE) * USUAL_RADIUS
        return replace(channel, name="v_x", values=values), SPEED
    return None


def computed_velocity(
    channels: Mapping[str, SourceChannel], guesses: Mapping[str, Guess]
) -> Guess | None:
    """
    Return the entry of `computed` for v_x; None if a column has it, or nothing is known.

    :param channels: raw values. :param guesses: the proposed entries of the same channels.
    """
    if "v_x" in channels:
        return None
    if any(is_wheel_speed(name) for name in channels):
        return _from_wheels(channels, guesses)
    if "gps_speed" in channels:
        return Guess("v_x", {"from": "gps"}, "speed over ground, without sideslip", True)
    return None


def computed_position(channels: Mapping[str, SourceChannel]) -> Guess | None:
    """Return the entry of `computed` for the position; None if columns have it, or no fix."""
    has_speed = "v_x" in channels or "gps_speed" in channels or any(map(is_wheel_speed, channels))
    if {"x", "y"} & channels.keys() or not {"latitude", "longitude"} <= channels.keys():
        return None
    reason = "metres to the east and north of the first fix"
    return Guess("position", {"from": "gps"}, reason, True) if has_speed else None


def _from_wheels(channels: Mapping[str, SourceChannel], guesses: Mapping[str, Guess]) -> Guess:
    axle, reason = undriven_axle(channels)
    entry: dict[str, Any] = {"from": "wheel_speeds", "wheels": axle}
    doubts = ["give the undriven axle"] if axle == "all" else []
    wheels = [name for name in channels if is_wheel_speed(name)]
    if all("wheel_radius" not in guesses[name].entry for name in wheels):
        if reference_of(channels) is not None:
            entry["wheel_radius"] = IDENTIFY
        else:
            entry["wheel_radius"] = USUAL_RADIUS
            doubts.append("wheel radius guessed")
    return Guess("v_x", entry, "; ".join([*doubts, reason]), not doubts)


def undriven_axle(channels: Mapping[str, SourceChannel]) -> tuple[str, str]:
    """
    Return the axle whose wheels do not slip under drive, "front" or "rear", and why.

    Driven wheels turn faster than free ones in proportion to the acceleration:
    omega_f / omega_r = c_0 + c_1 max(dv/dt, 0) + c_2 (yaw rate / v)², where the last term is the
    longer way of the front wheels in bends. "all" if one axle is missing, or c_1 may be 0.
    """
    axles = {axle: wheels_of(axle, channels) for axle in AXLES}
    present = [axle for axle, names in axles.items() if names]
    if len(present) < len(AXLES):
        return present[0], "the only wheel speeds"
    names = [name for group in axles.values() for name in group]
    begin = max(int(channels[name].stamp_ns[0]) for name in names) * 1e-9
    end = min(int(channels[name].stamp_ns[-1]) for name in names) * 1e-9
    count = max(int((end - begin) / STEP_S), 0)
    grid = np.asarray(begin + STEP_S * np.arange(count), dtype=np.float64)
    unclear = "which axle is driven is not clear"
    if grid.size < 3:
        return "all", unclear
    front, rear = (_mean(channels, axles[axle], grid) for axle in AXLES)
    speed = 0.5 * (front + rear)
    change = np.gradient(speed, STEP_S)
    moving = (speed > _MIN_SPEED * float(speed.max())) & (change > 0.0) & (rear > 0.0)
    safe = np.where(moving, speed, 1.0)
    rate = at_grid(channels["yaw_rate"], grid) if "yaw_rate" in channels else np.zeros_like(grid)
    columns = np.column_stack([np.maximum(change, 0.0), np.ones_like(grid), (rate / safe) ** 2])
    ratio = np.where(moving, front / np.where(moving, rear, 1.0), 1.0)
    fit = regress(columns, ratio, moving.astype(np.float64), period_s=STEP_S)
    if fit is None:
        return "all", unclear
    slip = fit.estimate(0)
    if slip.low <= 0.0 <= slip.high:
        return "all", unclear
    driven = "front" if slip.value > 0.0 else "rear"
    free = "rear" if driven == "front" else "front"
    share = abs(slip.value) * float(np.quantile(change[moving], 0.95))
    return free, f"the {driven} wheels turn {100.0 * share:.2g} % faster under drive"


def _mean(
    channels: Mapping[str, SourceChannel], names: tuple[str, ...], grid: FloatArray
) -> FloatArray:
    return np.asarray(np.mean([at_grid(channels[name], grid) for name in names], axis=0))
