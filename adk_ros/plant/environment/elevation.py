# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Height profile of a closed road: a smooth curve through given heights, plus undulations.

Both are periodic over the lap. The grade of a `RoadPatch` need not be: a road whose patches rise
in total keeps rising from lap to lap, like a spiral ramp.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from adk_ros.files.yaml_file import FileModel
from adk_ros.numerics.arrays import FloatArray


class Height(FileModel):
    """Height of the road at an arc length from the start of the lap, both in m."""

    at: float = Field(ge=0.0, le=1e5)
    height: float = Field(ge=-5e3, le=5e3)


class Undulation(FileModel):
    """
    Waves of the road between two arc lengths, m: amplitude sin(2 pi (s - start) / wavelength).

    They fade in and out over the first and the last wavelength, at most half of the interval.
    """

    start: float = Field(ge=0.0)
    end: float
    amplitude: float = Field(ge=-20.0, le=20.0)
    wavelength: float = Field(ge=3.0, le=1e4)

    @model_validator(mode="after")
    def _order(self) -> Undulation:
        if self.end <= self.start:
            raise ValueError("end must be greater than start")
        return self


def _periodic_spline(knots: list[Height], s: FloatArray, lap: float) -> FloatArray:
    """Evaluate the periodic cubic spline through `knots` at arc lengths `s`, m."""
    at = np.array([knot.at for knot in knots])
    height = np.array([knot.height for knot in knots])
    count = len(knots)
    if np.any(np.diff(at) <= 0.0):
        raise ValueError("the distances of heights must increase")
    if at[-1] >= lap:
        raise ValueError(f"a height is given at {at[-1]:g} m, but the lap has {lap:.0f} m")
    if count < 3:
        raise ValueError("needs at least three heights, or none")
    gap = np.diff(np.append(at, at[0] + lap))
    rise = (np.roll(height, -1) - height) / gap
    # h[i-1] M[i-1] + 2 (h[i-1] + h[i]) M[i] + h[i] M[i+1] = 6 (rise[i] - rise[i-1])
    system = np.zeros((count, count))
    for i in range(count):
        system[i, i - 1] += gap[i - 1]
        system[i, i] += 2.0 * (gap[i - 1] + gap[i])
        system[i, (i + 1) % count] += gap[i]
    bend = np.linalg.solve(system, 6.0 * (rise - np.roll(rise, 1)))
    local = (s - at[0]) % lap + at[0]
    i = np.clip(np.searchsorted(at, local, side="right") - 1, 0, count - 1)
    after, t, h = (i + 1) % count, local - at[i], gap[i]
    slope = rise[i] - h * (2.0 * bend[i] + bend[after]) / 6.0
    curve = bend[i] / 2.0 + t * (bend[after] - bend[i]) / (6.0 * h)
    return np.asarray(height[i] + t * (slope + t * curve))


def _undulation_height(wave: Undulation, s: FloatArray, lap: float) -> FloatArray:
    if wave.end > lap:
        raise ValueError(f"an undulation ends at {wave.end:g} m, but the lap has {lap:.0f} m")
    inside = np.minimum(s - wave.start, wave.end - s)
    over = min(wave.wavelength, 0.5 * (wave.end - wave.start))
    fade = 0.5 - 0.5 * np.cos(np.pi * np.clip(inside / over, 0.0, 1.0))
    phase = 2.0 * np.pi * (s - wave.start) / wave.wavelength
    return np.asarray(wave.amplitude * fade * np.sin(phase))


def profile_slope(
    knots: list[Height], waves: list[Undulation], rows: int, lap: float
) -> FloatArray:
    """
    Return the slope of the profile (rise over run) at `rows` + 1 points of the lap.

    Central differences of the height, whose sum over the lap is exactly zero.
    :raises ValueError: heights out of order, or a height or undulation beyond the lap.
    """
    s = lap / rows * np.arange(rows, dtype=np.float64)
    height = np.zeros(rows)
    if knots:
        height += _periodic_spline(knots, s, lap)
    for wave in waves:
        height += _undulation_height(wave, s, lap)
    slope = (np.roll(height, -1) - np.roll(height, 1)) * (0.5 * rows / lap)
    return np.append(slope, slope[0])
