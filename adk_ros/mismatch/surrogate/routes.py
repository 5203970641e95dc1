# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Routes of several recordings: which of them repeat the same lap.

Recordings are on one route if most poses of one lie on the lap of the other. This assumes that
their poses share a frame (a map, or odometry that starts at the same pose). Recordings of one
route in different frames are two routes: nothing wrong is concluded, only less.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.library.criteria import MIN_ROAD_COVERAGE
from adk_ros.mismatch.surrogate.activation import ROUTE_SPACING_M
from adk_ros.mismatch.surrogate.joined_problem import JoinedProblem
from adk_ros.mismatch.surrogate.lap import (
    MAX_CLOSURE_DISTANCE_M,
    MAX_HALF_HEADING_SINE,
    Lap,
    find_lap,
    project_on_lap,
)
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class Routes(Lap):
    """
    Laps of several routes, as one coordinate.

    Distances on route k begin at k times `ROUTE_SPACING_M`; `length` is that of the longest lap.
    The line is that of the first route. `laps`: of each route, with the distance (n,) of all
    recordings, NaN for those that are not on it.
    """

    laps: tuple[Lap, ...]

    @property
    def routes(self) -> tuple[Lap, ...]:
        """The laps of the routes."""
        return self.laps


def find_routes(problem: JoinedProblem) -> tuple[Lap | None, tuple[int | None, ...]]:
    """Return the laps of several recordings, and the route of each; None where there is none."""
    laps: list[Lap] = []
    route_of: list[int | None] = []
    for part in problem.parts:
        route = _route_through(laps, part.pose)
        own = find_lap(part) if route is None else None
        if own is not None:
            route = len(laps)
            laps.append(own)
        route_of.append(route)
    # A recording without a lap may be on the route of a later one.
    route_of = [
        _route_through(laps, part.pose) if route is None else route
        for part, route in zip(problem.parts, route_of, strict=True)
    ]
    joined = []
    for i, lap in enumerate(laps):
        distance = np.full(problem.steps, np.nan)
        for part, route, steps in zip(problem.parts, route_of, problem.step_slices, strict=True):
            if route == i:
                distance[steps] = project_on_lap(lap, part.pose)
        joined.append(replace(lap, distance=distance))
    if len(joined) < 2:
        return (joined[0] if joined else None), tuple(route_of)
    distances = [lap.distance + i * ROUTE_SPACING_M for i, lap in enumerate(joined)]
    everywhere = np.full(problem.steps, np.nan)
    for distance in distances:
        everywhere = np.where(np.isfinite(distance), distance, everywhere)
    first = joined[0]
    longest = max(lap.length for lap in joined)
    routes = Routes(longest, first.line, first.line_s, everywhere, tuple(joined))
    return routes, tuple(route_of)


def _route_through(laps: list[Lap], pose: FloatArray) -> int | None:
    """Return the index of the lap on which most of the poses (n, 3) lie, or None."""
    return next((i for i, lap in enumerate(laps) if _covers(lap, pose)), None)


def _covers(lap: Lap, pose: FloatArray) -> bool:
    at = project_on_lap(lap, pose)
    row = np.minimum(np.searchsorted(lap.line_s, at), lap.line.shape[0] - 1)
    on = lap.line[row]
    near = np.hypot(pose[:, 0] - on[:, 0], pose[:, 1] - on[:, 1]) < MAX_CLOSURE_DISTANCE_M
    along = np.abs(np.sin(0.5 * (pose[:, 2] - on[:, 2]))) < MAX_HALF_HEADING_SINE
    return bool((near & along).mean() >= MIN_ROAD_COVERAGE)
