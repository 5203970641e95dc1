# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Paths to follow: a double lane change with the gates of ISO 3888-1, and a lap of a small circuit.

Both begin with an approach that a driver drives, the same for all controllers and models, so that
a model that adapts has known the car for some time. Only what follows it is scored. Speeds are
such that the path needs 0.8 of the grip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import (
    ROAD_CURVATURE,
    ROAD_HEADING,
    ROAD_MU,
    ROAD_SIZE,
    ROAD_SPEED,
    ROAD_X,
    ROAD_Y,
    SPACING,
    Bend,
    Route,
    Segment,
    build_route,
)
from adk_ros.plant.scenario.driver import SpeedPlan, plan_speed

GRIP_SHARE = 0.8
"""Lateral acceleration of the paths over the grip."""
WIDTH = 1.9
"""Width of the car, m: its track of 1.715 m and tyres of about 0.2 m."""
APPROACH_S = 20.0
"""Duration of the approach, s: the windowed online method uses the last 10 s."""
LANE_CHANGE, LAP = "double lane change", "lap"
MANOEUVRES = (LANE_CHANGE, LAP)

_OFFSET = 3.5
"""Lateral offset of the second lane, m (ISO 3888-1)."""
_SECTIONS = (15.0, 30.0, 25.0, 25.0, 15.0)
"""Lengths of lane, lane change, offset lane, lane change back and lane, m (ISO 3888-1)."""
_GATE_WIDTHS = ((1.1, 0.25), (1.2, 0.25), (1.3, 0.25))
"""Widths of the three lanes: factor on the width of the car, and what is added, m (same)."""
_REACH = 5.0
"""By how much the lane changes of the path reach into the lanes, m: at most 6 cm of offset."""
_SLALOM_WAVELENGTH, _SLALOM_SHARE = 90.0, 0.35
"""Approach to the lane change: wavelength in m, and its lateral acceleration over the grip."""
_SETTLE, _EXIT = 30.0, 200.0
"""Between handover and scored part, and after the last gate, m."""
_LANE_WIDTH = 3.5
_TRACE_STEP = 0.05
_LAP_SEGMENTS: tuple[dict[str, object], ...] = (
    {"straight": 90}, {"bend": Bend(radius=20, angle_deg=90, transition=10)},
    {"straight": 45}, {"bend": Bend(radius=35, angle_deg=60, transition=12)},
    {"bend": Bend(radius=25, angle_deg=-70, transition=10)}, {"straight": 40},
    {"bend": Bend(radius=15, angle_deg=100, transition=8)}, {"straight": 70},
    {"bend": Bend(radius=30, angle_deg=90, transition=12)}, {"straight": 60},
    {"bend": Bend(radius=22, angle_deg=90, transition=10)},
)  # fmt: skip


@dataclass(frozen=True)
class ReferencePath:
    """
    A path as a route with its planned speed, and where it is scored.

    `start`, `handover`, `begin`, `end`: arc lengths of the start of the approach, of the handover
    from the driver to the controller, and of the begin and the end of the scored part, m.
    `tolerance` (rows,): largest lateral error at the rows of the route, m, infinite where there is
    no gate.
    """

    name: str
    route: Route
    start: float
    handover: float
    begin: float
    end: float
    tolerance: FloatArray

    def tolerance_at(self, s: FloatArray) -> FloatArray:
        """Return the tolerance at arc lengths `s` (n,), m."""
        rows = len(self.tolerance) - 1
        nearest = np.rint(s / self.route.spacing).astype(int) % rows
        return np.asarray(self.tolerance[nearest])

    def planned_s(self, begin: float, end: float) -> float:
        """Return the planned duration between two arc lengths, s."""
        rows = np.arange(math.floor(begin / self.route.spacing), end / self.route.spacing)
        speeds = self.route.table[rows.astype(int) % (len(self.tolerance) - 1), ROAD_SPEED]
        return float(np.sum(self.route.spacing / speeds))

    def pose_at(self, s: float) -> tuple[FloatArray, float]:
        """Return pose (x, y, heading) and speed of the row next to arc length `s`, SI."""
        table = self.route.table
        row = table[round(s / self.route.spacing) % (len(table) - 1)]
        return row[[ROAD_X, ROAD_Y, ROAD_HEADING]].copy(), float(row[ROAD_SPEED])


def reference_path(name: str, grip: float) -> ReferencePath:
    """Return one of `MANOEUVRES` for a car of that `grip`, m/s²."""
    return _double_lane_change(grip) if name == LANE_CHANGE else _lap(grip)


def _double_lane_change(grip: float) -> ReferencePath:
    """
    Return the lane change; its lateral positions are y(x), lane changes quintic polynomials.

    The peak curvature of a quintic over a length l is 10 / sqrt(3) times offset / l².
    """
    _, change, _, back, _ = _SECTIONS
    sharpest = 10.0 / math.sqrt(3.0) * _OFFSET / (min(change, back) + 2.0 * _REACH) ** 2
    speed = math.sqrt(GRIP_SHARE * grip / sharpest)
    waves = math.ceil(APPROACH_S * speed / _SLALOM_WAVELENGTH)
    slalom = waves * _SLALOM_WAVELENGTH
    gate = slalom + _SETTLE
    edges = gate + np.cumsum((0.0, *_SECTIONS))
    x = np.arange(0.0, edges[-1] + _EXIT, _TRACE_STEP)
    wave = 2.0 * math.pi / _SLALOM_WAVELENGTH
    amplitude = _SLALOM_SHARE * grip / (wave * speed) ** 2
    edge = np.clip(np.minimum(x, slalom - x) / _SLALOM_WAVELENGTH, 0.0, 1.0)
    y = amplitude * (0.5 - 0.5 * np.cos(math.pi * edge)) * np.sin(wave * x)
    y += _OFFSET * _quintic((x - edges[1] + _REACH) / (change + 2.0 * _REACH))
    y -= _OFFSET * _quintic((x - edges[3] + _REACH) / (back + 2.0 * _REACH))
    slope = np.gradient(y, x)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    rows = round(s[-1] / SPACING)
    at = np.linspace(0.0, s[-1], rows + 1)
    table = np.zeros((rows + 1, ROAD_SIZE))
    curvature = np.gradient(slope, x) / (1.0 + slope**2) ** 1.5
    for column, values in (
        (ROAD_X, x), (ROAD_Y, y), (ROAD_HEADING, np.arctan(slope)), (ROAD_CURVATURE, curvature),
    ):  # fmt: skip
        table[:, column] = np.interp(at, s, values)
    table[:, ROAD_SPEED], table[:, ROAD_MU] = speed, 1.0
    tolerance = np.full(rows + 1, np.inf)
    for (begin, end), (factor, added) in zip(((0, 1), (2, 3), (4, 5)), _GATE_WIDTHS, strict=True):
        inside = (table[:, ROAD_X] >= edges[begin]) & (table[:, ROAD_X] <= edges[end])
        tolerance[inside] = 0.5 * ((factor - 1.0) * WIDTH + added)
    handover, begin_s, end_s = np.interp([gate - _SETTLE, gate, edges[-1]], x, s).tolist()
    route = Route(table, s[-1] / rows)
    return ReferencePath(LANE_CHANGE, route, 0.0, handover, begin_s, end_s, tolerance)


def _quintic(t: FloatArray) -> FloatArray:
    """Return the polynomial from 0 to 1 with zero slope and curvature at both ends."""
    t = np.clip(t, 0.0, 1.0)
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))


def _lap(grip: float) -> ReferencePath:
    segments = [Segment.model_validate(segment) for segment in _LAP_SEGMENTS]
    # Braking at half of the grip, speeding up at a quarter: less than the motors can.
    plan = SpeedPlan(
        top=22.0, lateral_accel=GRIP_SHARE * grip, accel=0.25 * grip, brake=0.5 * grip,
        variation=0.0,
    )  # fmt: skip
    route = plan_speed(build_route(segments, [], 1.0), plan)
    speeds = route.table[:-1, ROAD_SPEED]
    # Backwards from the finish, until the approach has its duration.
    before = np.cumsum(route.spacing / speeds[::-1])
    approach = route.spacing * min(int(np.searchsorted(before, APPROACH_S)), len(speeds))
    tolerance = np.full(len(route.table), 0.5 * (_LANE_WIDTH - WIDTH))
    lap = route.length
    return ReferencePath(LAP, route, lap - approach, lap - _SETTLE, lap, 2.0 * lap, tolerance)
