# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where open-loop predictions of a recording begin."""

from __future__ import annotations

import numpy as np

from adk_ros.errors import DataError
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS

FIRST_START_S = 2.0
"""s. Earlier starts would have too few measurements before them."""
_MAX_ODOMETRY_AGE_S = 0.1
"""s. A start needs a measurement at most this old."""


def start_times_of(log: SensorLog, ticks: int, stride_s: float, from_s: float) -> FloatArray:
    """
    Return starts (n,) on the tick grid, every `stride_s` from `from_s` on, with known commands.

    Raises `DataError` where there is none.
    """
    phase = (-log.start_ns % TICK_NS) * 1e-9
    tick = TICK_NS * 1e-9
    last = min(log.duration_s, float(log.command_s[-1]) + 2.0 * tick) - ticks * tick
    wanted = np.arange(from_s, last + 1e-9, stride_s)
    starts = np.unique(phase + tick * np.ceil((wanted - phase) / tick - 1e-6))
    starts = starts[starts <= last + 1e-9]
    before = np.searchsorted(log.odometry_s, starts + 1e-9) - 1
    age = starts - log.odometry_s[np.maximum(before, 0)]
    starts = starts[(before >= 0) & (age < _MAX_ODOMETRY_AGE_S)]
    if starts.size == 0:
        raise DataError(
            f"{log.name}: no start after {from_s:g} s has commands for "
            f"{ticks * tick:g} s: give a longer bag, or a shorter --horizon"
        )
    return np.asarray(starts)
