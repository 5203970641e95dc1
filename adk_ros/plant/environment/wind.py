# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wind over the map: a steady component and gusts over time."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from adk_ros.files.yaml_file import FileModel
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.environment.coloured_noise import coloured_noise
from adk_ros.signals.channels import TICK_NS


class Wind(FileModel):
    """Wind in m/s towards +x and +y of the map."""

    x: float = Field(default=0.0, ge=-60.0, le=60.0)
    y: float = Field(default=0.0, ge=-60.0, le=60.0)
    gust: float = Field(default=0.0, ge=0.0, le=30.0)
    """Standard deviation of the gusts in either direction, m/s."""
    gust_bandwidth_hz: float = Field(default=0.25, gt=0.001, le=5.0)


def wind_series(rng: np.random.Generator, wind: Wind, ticks: int) -> FloatArray:
    """Return the wind (ticks + 1, 2), one row per tick of 25 ms, linear in between."""
    out = np.tile([wind.x, wind.y], (ticks + 1, 1))
    if wind.gust > 0.0:
        period_s = TICK_NS * 1e-9
        for column in range(2):
            noise = coloured_noise(rng, ticks + 1, period_s, wind.gust_bandwidth_hz)
            out[:, column] += wind.gust * noise
    return out


@strict_kernel
def wind_at(series: FloatArray, step: int, tick: int) -> tuple[float, float]:
    """Return the wind at integration step `step`; a tick has `tick` steps."""
    last = series.shape[0] - 1
    row = min(step // tick, last)
    after = min(row + 1, last)
    share = (step - row * tick) / tick
    return (
        series[row, 0] + share * (series[after, 0] - series[row, 0]),
        series[row, 1] + share * (series[after, 1] - series[row, 1]),
    )
