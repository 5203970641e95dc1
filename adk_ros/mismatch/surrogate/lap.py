# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Laps: position along a route that the vehicle repeats."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.surrogate.residuals import STEP_S, ResidualProblem
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import relaxed_kernel

HEADING_WEIGHT_M2 = 400.0
"""
Weight of sin^2(half the heading difference) against squared distance when a pose is matched to a
line, m^2: 6 degrees count as much as one metre. Tells the directions of a road apart.
"""
MAX_HALF_HEADING_SINE = 0.3
"""Largest sine of half the heading difference between two passes of one place: 35 degrees."""
MAX_CLOSURE_DISTANCE_M = 12.0
"""A lap closes where the vehicle returns to within this distance of an earlier pose, m."""
_MAX_PROJECTED_HALF_HEADING_SINE = 0.4
"""Largest sine of half the heading difference to a known line: a predicted pose may drift."""
_MIN_LAP_M = 150.0
_LINE_STRIDE = 20
"""Steps between two rows of a lap's line: 0.2 s."""
_ROWS_BEHIND = 5
_ROWS_SEARCHED = 20
"""Rows of the line searched per pose, from `_ROWS_BEHIND` rows behind the last match: 4 s."""


@dataclass(frozen=True)
class Lap:
    """
    One lap of a route.

    `length` in m; `line` (k, 3): x, y, heading, one row per 0.2 s; `line_s` (k,): distance of each
    row from the start of the lap, m.
    """

    length: float
    line: FloatArray
    line_s: FloatArray
    distance: FloatArray
    """(n,) distance along the lap at each step of the recording, m; NaN where it is on none."""

    @property
    def unwrapped(self) -> FloatArray:
        """Distance (n,), continued from lap to lap, m."""
        out, known = self.distance.copy(), np.isfinite(self.distance)
        out[known] = np.unwrap(self.distance[known], period=self.length)
        return np.asarray(out)

    @property
    def routes(self) -> tuple[Lap, ...]:
        """The laps of the routes that the recordings drive: this one."""
        return (self,)


@relaxed_kernel
def _project_on_lap(
    line: FloatArray, line_s: FloatArray, length: float, pose: FloatArray, out: FloatArray
) -> None:
    """Write the lap distance of each pose (n, 3) into `out`; each search starts at the last."""
    rows = line.shape[0]
    at = 0
    for k in range(pose.shape[0]):
        best, best_i = 1e30, at
        # Search around the last match; the whole line for the first pose.
        first, count = (0, rows) if k == 0 else (at - _ROWS_BEHIND, _ROWS_SEARCHED)
        for j in range(first, first + count):
            i = j % rows
            dx, dy = pose[k, 0] - line[i, 0], pose[k, 1] - line[i, 1]
            half_turn = math.sin(0.5 * (pose[k, 2] - line[i, 2]))
            mismatch = dx * dx + dy * dy + HEADING_WEIGHT_M2 * half_turn * half_turn
            if mismatch < best:
                best, best_i = mismatch, i
        at = best_i
        dx, dy = pose[k, 0] - line[at, 0], pose[k, 1] - line[at, 1]
        ahead = dx * math.cos(line[at, 2]) + dy * math.sin(line[at, 2])
        out[k] = (line_s[at] + ahead) % length


def find_lap(problem: ResidualProblem) -> Lap | None:
    """
    Return the lap that a recording repeats, or None if no place is passed twice.

    None for a scale model: the lengths of this module are those of full-size roads. None where the
    pose does not change: a recording without positions, which would return everywhere.

    The lap ends where the vehicle first returns to within `MAX_CLOSURE_DISTANCE_M` of the start of
    the lap with the same heading. If it never returns to its first position, later ones are tried.
    """
    if problem.log.length_scale < 1.0:
        return None
    pose, speed = problem.pose, problem.smoothed_odometry[:, 0]
    if np.ptp(pose[:, 0]) == 0.0 and np.ptp(pose[:, 1]) == 0.0:
        return None
    travelled = np.concatenate([[0.0], np.cumsum(speed[:-1] * STEP_S)])
    n = pose.shape[0]
    for begin in range(0, n // 2, max(n // 8, 1)):
        away = np.hypot(pose[:, 0] - pose[begin, 0], pose[:, 1] - pose[begin, 1])
        half_turn = np.abs(np.sin(0.5 * (pose[:, 2] - pose[begin, 2])))
        returned = (
            (away < MAX_CLOSURE_DISTANCE_M)
            & (half_turn < MAX_HALF_HEADING_SINE)
            & (travelled - travelled[begin] > _MIN_LAP_M)
        )
        if not returned.any():
            continue
        first = int(np.argmax(returned))
        last = first + int(np.argmin(returned[first:])) if not returned[first:].all() else n
        end = first + int(np.argmin(away[first:last]))
        rows = np.arange(begin, end, _LINE_STRIDE)
        length = float(travelled[end] - travelled[begin])
        line_s = travelled[rows] - travelled[begin]
        lap = Lap(length, np.ascontiguousarray(pose[rows]), line_s, np.empty(0))
        return replace(lap, distance=project_on_lap(lap, pose))
    return None


def project_on_lap(lap: Lap, pose: FloatArray) -> FloatArray:
    """Return the distance along a lap (n,) of the poses (n, 3) of a recording, m."""
    distance = np.empty(pose.shape[0])
    poses = np.ascontiguousarray(pose)
    _project_on_lap(lap.line, lap.line_s, lap.length, poses, distance)
    return distance


def distance_on_lap(
    line: FloatArray, length: float, pose: FloatArray, max_distance: float
) -> float:
    """
    Return the distance along a lap of a pose (3,), m.

    NaN if the pose is more than `max_distance` off the line or heads the other way. `line` (k, 4):
    distance, x, y, heading.
    """
    away = np.hypot(line[:, 1] - pose[0], line[:, 2] - pose[1])
    half_turn = np.sin(0.5 * (line[:, 3] - pose[2]))
    i = int(np.argmin(away**2 + HEADING_WEIGHT_M2 * half_turn**2))
    if away[i] > max_distance or abs(half_turn[i]) > _MAX_PROJECTED_HALF_HEADING_SINE:
        return math.nan
    ahead = (pose[0] - line[i, 1]) * math.cos(line[i, 3])
    ahead += (pose[1] - line[i, 2]) * math.sin(line[i, 3])
    return float((line[i, 0] + ahead) % length)
