# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Laps: where along the route a car is, when it drives the same one again and again."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.surrogate.residuals import STEP_S, ResidualProblem
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import relaxed_kernel

MAX_CLOSURE_DISTANCE_M = 12.0
"""m; closer than this to where it was, heading alike, the car is there again."""
_MIN_LAP_M = 150.0
_STRIDE = 20


@dataclass(frozen=True)
class Lap:
    """One lap: its `length` in m, its line (k, 3) x, y, heading every 0.2 s, and `s` along it."""

    length: float
    line: FloatArray
    line_s: FloatArray
    distance: FloatArray
    """(n,) metres along the lap at each step of the course."""

    @property
    def unwrapped(self) -> FloatArray:
        """The distance (n,), going on from lap to lap."""
        return np.asarray(np.unwrap(self.distance, period=self.length))


@relaxed_kernel
def _along(
    line: FloatArray, line_s: FloatArray, length: float, pose: FloatArray, out: FloatArray
) -> None:
    """Project each pose (n, 3) on the line, tracking from the one before."""
    rows = line.shape[0]
    at = 0
    for k in range(pose.shape[0]):
        best, best_i = 1e30, at
        # Ahead of the last place and a little behind; the whole line at the start.
        first, count = (0, rows) if k == 0 else (at - 5, 20)
        for j in range(first, first + count):
            i = j % rows
            dx, dy = pose[k, 0] - line[i, 0], pose[k, 1] - line[i, 1]
            turn = math.sin(0.5 * (pose[k, 2] - line[i, 2]))
            far = dx * dx + dy * dy + 400.0 * turn * turn
            if far < best:
                best, best_i = far, i
        at = best_i
        dx, dy = pose[k, 0] - line[at, 0], pose[k, 1] - line[at, 1]
        ahead = dx * math.cos(line[at, 2]) + dy * math.sin(line[at, 2])
        out[k] = (line_s[at] + ahead) % length


def find_lap(course: ResidualProblem) -> Lap | None:
    """
    Return the lap that a course repeats, or None where no place is passed twice.

    The lap ends where the car first comes within `NEAR` metres of where it began, heading the
    same way; failing that for its first position, later ones are tried.
    """
    pose, speed = course.pose, course.smoothed_odometry[:, 0]
    driven = np.concatenate([[0.0], np.cumsum(speed[:-1] * STEP_S)])
    n = pose.shape[0]
    for begin in range(0, n // 2, max(n // 8, 1)):
        away = np.hypot(pose[:, 0] - pose[begin, 0], pose[:, 1] - pose[begin, 1])
        turned = np.abs(np.sin(0.5 * (pose[:, 2] - pose[begin, 2])))
        back = (
            (away < MAX_CLOSURE_DISTANCE_M)
            & (turned < 0.3)
            & (driven - driven[begin] > _MIN_LAP_M)
        )
        if not back.any():
            continue
        first = int(np.argmax(back))
        last = first + int(np.argmin(back[first:])) if not back[first:].all() else n
        end = first + int(np.argmin(away[first:last]))
        rows = np.arange(begin, end, _STRIDE)
        length = float(driven[end] - driven[begin])
        line_s = driven[rows] - driven[begin]
        distance = np.empty(n)
        line = np.ascontiguousarray(pose[rows])
        _along(line, line_s, length, np.ascontiguousarray(pose), distance)
        return Lap(length, line, line_s, distance)
    return None


def distance_on_lap(line: FloatArray, length: float, pose: FloatArray, far: float) -> float:
    """
    Return where on a lap a pose (3,) is, m, or NaN where it is off it or drives the other way.

    `line` (k, 4): distance, x, y, heading.
    """
    away = np.hypot(line[:, 1] - pose[0], line[:, 2] - pose[1])
    turn = np.sin(0.5 * (line[:, 3] - pose[2]))
    i = int(np.argmin(away**2 + 400.0 * turn**2))
    if away[i] > far or abs(turn[i]) > 0.4:
        return math.nan
    ahead = (pose[0] - line[i, 1]) * math.cos(line[i, 3])
    ahead += (pose[1] - line[i, 2]) * math.sin(line[i, 3])
    return float((line[i, 0] + ahead) % length)
