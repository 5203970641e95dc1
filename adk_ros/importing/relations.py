# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Relations between channels that hold for every car, on a common time.

    a_y = v_x r,   a_x = dv_x/dt,   |v| = |d(x, y)/dt|,   d(heading)/dt = r

Valid at small sideslip and on level road to some 10 %, while wrong units are off by a factor of
1.6 or more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from adk_ros.importing.source_channels import SourceChannel
from adk_ros.numerics.arrays import FloatArray

STEP_S = 0.05
_MAX_STEPS = 40_000
"""Samples compared, half an hour: enough for any unit."""
_SMOOTHED_S = 0.5
"""s over which signals are averaged before they are compared: noise and suspension vanish."""
_MIN_CORRELATION = 0.6
"""Correlation of both sides below which a relation says nothing: too little excitation."""


def common_grid(channels: Mapping[str, SourceChannel]) -> FloatArray | None:
    """Return the times common to the channels, s; None if there are hardly any."""
    main = [channels[name] for name in ("v_x", "yaw_rate", "a_x", "a_y") if name in channels]
    if not main:
        return None
    begin = max(int(channel.stamp_ns[0]) for channel in main) * 1e-9
    end = min(int(channel.stamp_ns[-1]) for channel in main) * 1e-9
    count = min(int((end - begin) / STEP_S), _MAX_STEPS)
    grid = begin + STEP_S * np.arange(count)
    return np.asarray(grid, dtype=np.float64) if count * STEP_S > 4.0 * _SMOOTHED_S else None


def at_grid(channel: SourceChannel, grid: FloatArray) -> FloatArray:
    """Return the channel at the times of the grid, averaged over `_SMOOTHED_S`."""
    values = np.interp(grid, channel.stamp_ns * 1e-9, channel.values)
    if channel.name == "heading" and np.ptp(values) > 0.0:
        period = 2.0 * math.pi if np.abs(channel.values).max() < 7.0 else 360.0
        unwrapped = np.unwrap(channel.values, period=period)
        values = np.interp(grid, channel.stamp_ns * 1e-9, unwrapped)
    width = max(round(_SMOOTHED_S / STEP_S), 1)
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.asarray(np.convolve(padded, np.full(width, 1.0 / width), mode="valid"))


@dataclass(frozen=True)
class Relation:
    """Left = ratio * right with a correlation; the units of both sides as channel names."""

    ratio: float
    correlation: float
    left: str
    right: tuple[str, ...]
    text: str

    @property
    def is_useful(self) -> bool:
        """Whether the correlation allows a statement."""
        return abs(self.correlation) >= _MIN_CORRELATION and self.ratio != 0.0


def relation(
    left: FloatArray, right: FloatArray, name: str, factors: tuple[str, ...], text: str
) -> Relation:
    """Return the relation left (n,) = ratio * right (n,), apart from a constant."""
    # An offset of the accelerometer, or a bank, is no factor.
    left, right = left - left.mean(), right - right.mean()
    power, other = float(right @ right), float(left @ left)
    if power <= 0.0 or other <= 0.0:
        return Relation(0.0, 0.0, name, factors, text)
    product_ = float(left @ right)
    correlation = product_ / math.sqrt(power * other)
    # Noise on one side lowers its regression; the ratio of the spreads is in the middle.
    return Relation(
        math.copysign(math.sqrt(other / power), product_), correlation, name, factors, text
    )


def relations(signals: Mapping[str, FloatArray]) -> list[Relation]:
    """Return the relations of v_x, yaw rate and accelerations."""
    out = []
    v, rate = signals.get("v_x"), signals.get("yaw_rate")
    if v is not None and rate is not None and "a_y" in signals:
        lateral = relation(
            signals["a_y"], v * rate, "a_y", ("v_x", "yaw_rate"), "a_y = v_x * yaw rate"
        )
        out.append(lateral)
    if v is not None and "a_x" in signals:
        change = np.gradient(v, STEP_S)
        out.append(relation(signals["a_x"], change, "a_x", ("v_x",), "a_x = dv_x/dt"))
    if v is not None and "x" in signals and "y" in signals:
        moved = np.hypot(np.gradient(signals["x"], STEP_S), np.gradient(signals["y"], STEP_S))
        out.append(
            relation(moved, np.abs(v), "x", ("v_x",), "v_x = distance of the positions / time")
        )
    if v is not None and "gps_speed" in signals:
        out.append(
            relation(signals["gps_speed"], np.abs(v), "gps_speed", ("v_x",), "v_x = GPS speed")
        )
    if rate is not None and "heading" in signals:
        turned = np.gradient(signals["heading"], STEP_S)
        out.append(relation(turned, rate, "heading", ("yaw_rate",), "yaw rate = d(heading)/dt"))
    return [each for each in out if each.is_useful]
