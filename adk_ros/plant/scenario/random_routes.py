# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Random closed routes for generated cases: a fast track and a town."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import ROAD_MU, Bend, RoadPatch, Route, Segment, build_route
from adk_ros.plant.scenario.driver import SpeedPlan, plan_speed

Range = tuple[float, float]
_SLOWER, _MAX_TRIES = 0.9, 9
"""Speed factor from one try to the next, and most tries without a spin, by choice."""
_SPIN_V_Y = 3.0
"""
Lateral velocity from which on the vehicle counts as spinning, m/s, by choice: 11° of sideslip in
town, 5° at the top speed of the track. Drives of published figures depend on it.
"""


class RoadStyle(NamedTuple):
    """Ranges for the geometry of a road and the speeds on it; m, m/s, m/s²."""

    bends: int
    straight: Range
    radius: Range
    transition: float
    lap: Range
    top: float
    lateral: Range
    accel: float
    brake: float


ROAD_STYLES = {
    "track": RoadStyle(
        9, (20.0, 130.0), (45.0, 130.0), 20.0, (1000.0, 2200.0), 33.0, (4.0, 5.0), 2.3, 2.6
    ),
    "town": RoadStyle(
        9, (20.0, 90.0), (14.0, 40.0), 6.0, (500.0, 1200.0), 15.0, (3.6, 4.8), 1.8, 2.4
    ),
}
_TRIES = 200


def random_route(rng: np.random.Generator, roads: RoadStyle) -> tuple[list[Segment], float]:
    """Return the segments of a random closed route and its length, m."""
    for _ in range(_TRIES):
        signs = np.ones(roads.bends)
        signs[rng.choice(roads.bends - 2, 2, replace=False) + 1] = -1.0
        angles = signs * rng.uniform(40.0, 110.0, roads.bends)
        angles[int(np.argmax(signs))] += 360.0 - angles.sum()
        size = np.abs(angles)
        if size.min() < 30.0 or size.max() > 170.0:
            continue
        try:
            segments = [segment for angle in angles for segment in _drawn(rng, roads, angle)]
            length = build_route(segments, [], 1.0).length
        except ValueError:
            # A bend is shorter than its transition, or the route does not close.
            continue
        if roads.lap[0] < length < roads.lap[1]:
            return segments, length
    raise ValueError("no random route closes")


def _drawn(rng: np.random.Generator, roads: RoadStyle, angle: float) -> tuple[Segment, Segment]:
    """Return a straight and a bend of `angle` degrees."""
    straight = float(rng.uniform(*roads.straight))
    radius = float(rng.uniform(*roads.radius))
    bend = Bend(radius=radius, angle_deg=float(angle), transition=roads.transition)
    return Segment(straight=straight), Segment(bend=bend)


def plan_route(
    segments: list[Segment],
    places: list[RoadPatch],
    roads: RoadStyle,
    lateral: float,
    speed_factor: float = 1.0,
) -> Route:
    """
    Return the route with its speed plan, cornering at `lateral` m/s².

    `speed_factor` multiplies all speeds.
    """
    lateral *= speed_factor**2
    plan = SpeedPlan(
        top=speed_factor * roads.top,
        lateral_accel=lateral,
        accel=roads.accel,
        brake=roads.brake,
        variation=0.05,
    )
    return plan_speed(build_route(segments, places, 1.0), plan)


class AlwaysSpins(DataError):
    """A vehicle spins at every speed that is tried."""


def slower_routes(
    name: str,
    segments: list[Segment],
    places: list[RoadPatch],
    roads: RoadStyle,
    lateral: float,
    friction: float = 1.0,
) -> Iterator[tuple[Route, Route]]:
    """
    Yield the route at decreasing speeds: one to take until a vehicle does not spin.

    Each with the same route whose friction is multiplied by `friction`.

    :param name: of the drive, for the message.
    :raises AlwaysSpins: another one is asked for after the slowest.
    """
    for tried in range(_MAX_TRIES):
        route = plan_route(segments, places, roads, lateral, _SLOWER**tried)
        table = route.table
        if friction != 1.0:
            table = table.copy()
            table[:, ROAD_MU] *= friction
        yield route, replace(route, table=table)
    raise AlwaysSpins(f"{name}: the car spins at every speed that is tried")


def spins(*lateral_velocities: FloatArray) -> bool:
    """
    Return whether the vehicle spins in any of the drives with these v_y, m/s.

    A simulation that ends in no number has spun as well.
    """
    return not all(float(np.abs(v_y).max()) < _SPIN_V_Y for v_y in lateral_velocities)
