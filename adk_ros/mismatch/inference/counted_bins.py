# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bins of a recording that do not count: of a car that stands, and without measurements."""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.library.criteria import MIN_SPEED, SETTLING_S
from adk_ros.mismatch.recording.frozen_readings import gaps
from adk_ros.mismatch.surrogate.residuals import BIN_S, ResidualProblem
from adk_ros.numerics.arrays import BoolArray
from adk_ros.numerics.differentiation import SMOOTHING_WINDOW_S

_SMOOTHED_S = 0.5 * SMOOTHING_WINDOW_S
"""s before a gap of odometry in which its smoothed values depend on the gap."""


def stationary_bins(problem: ResidualProblem) -> BoolArray:
    """Return the bins (b,) in which the car is slower than `MIN_SPEED`, or was just before."""
    speed = np.abs(problem.smoothed_odometry[:, 0])
    slow = np.interp(problem.bin_s, problem.middle_s, speed) < problem.log.similar(MIN_SPEED)
    after = np.ones(round(SETTLING_S / BIN_S), dtype=np.int64)
    return np.asarray(np.convolve(slow.astype(np.int64), after)[: slow.shape[0]] > 0)


def unmeasured_bins(problem: ResidualProblem) -> BoolArray:
    """
    Return the bins (b,) in a gap of odometry, or just after one.

    There the surrogate follows interpolated measurements, which are no data.
    """
    out = np.zeros(problem.bins, dtype=bool)
    for begin, end in gaps(problem.log.odometry_s):
        # Smoothing spreads what is interpolated by a fraction of the settling time.
        out |= (problem.bin_s > begin - _SMOOTHED_S) & (problem.bin_s < end + SETTLING_S)
    return out
