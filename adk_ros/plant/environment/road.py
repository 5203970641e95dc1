# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Closed route as a table over arc length, and projection of a position on it.

A route is a sequence of straights, bends and slaloms. Curvature is continuous (bends have linear
transitions). The lengths of the straights are adjusted with the least sum of squares that closes
the loop, so approximate lengths suffice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field, model_validator

from adk_ros.files.yaml_file import FileModel
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.numerics.similarity import time_scale
from adk_ros.plant.environment.elevation import Height, Undulation, profile_slope

SPACING = 0.5
"""Approximate distance between the rows of the table, m."""

ROAD_X, ROAD_Y, ROAD_HEADING, ROAD_CURVATURE = 0, 1, 2, 3
ROAD_MU, ROAD_GRADE, ROAD_BANK, ROAD_SPEED = 4, 5, 6, 7
ROAD_HEIGHT, ROAD_SLOPE, ROAD_CAMBER = 8, 9, 10
ROAD_SIZE = 11
"""
Columns of a route table; ROAD_SPEED is filled in by `plan_speed`.

Grade and bank are angles, slope and camber their tangents; height is the integral of the slope.
"""

_TRACE_STEP = 0.05
"""Step of the numerical integration of the path, m."""
_MIN_STRAIGHT = 5.0
"""Shortest straight after closing the loop, m."""


class Bend(FileModel):
    """A bend, left positive, with a linear transition of curvature at either end."""

    radius: float = Field(ge=6.0, le=1e5)
    angle_deg: float = Field(ge=-400.0, le=400.0)
    transition: float = Field(default=8.0, ge=0.0, le=1e3)
    """Length of the linear transition at either end, m."""

    @model_validator(mode="after")
    def _fits_transition(self) -> Bend:
        if abs(math.radians(self.angle_deg)) * self.radius < self.transition:
            raise ValueError("the bend is shorter than its transition")
        return self

    @property
    def length(self) -> float:
        """Arc length including transitions, m."""
        return abs(math.radians(self.angle_deg)) * self.radius + self.transition


class Slalom(FileModel):
    """
    Weaving about a straight line: curvature amplitude (2 pi / wavelength)^2 cos(...).

    It fades in and out over the first and the last wave and does not change the heading in total.
    """

    amplitude: float = Field(gt=0.0, le=20.0)
    """Lateral amplitude, m."""
    wavelength: float = Field(ge=10.0, le=1e3)
    """Wavelength, m."""
    waves: int = Field(ge=3, le=100)

    @property
    def length(self) -> float:
        """Arc length, m."""
        return self.wavelength * self.waves


class Segment(FileModel):
    """One segment of a route: exactly one of `straight` (m), `bend`, `slalom`."""

    straight: float | None = Field(default=None, gt=0.0, le=1e4)
    bend: Bend | None = None
    slalom: Slalom | None = None

    @model_validator(mode="after")
    def _one(self) -> Segment:
        if sum(part is not None for part in (self.straight, self.bend, self.slalom)) != 1:
            raise ValueError("give exactly one of straight, bend, slalom")
        return self


class RoadPatch(FileModel):
    """Road properties that differ between two arc lengths of the lap, m."""

    start: float = Field(ge=0.0)
    end: float
    mu: float | None = Field(default=None, ge=0.05, le=1.5)
    grade: float | None = Field(default=None, ge=-0.3, le=0.3)
    bank: float | None = Field(default=None, ge=-0.3, le=0.3)
    speed_max: float | None = Field(default=None, ge=3.0, le=80.0)
    blend: float = Field(default=5.0, ge=0.0, le=200.0)
    """Length of the transition at either end, inside the patch, m."""

    @model_validator(mode="after")
    def _order(self) -> RoadPatch:
        if self.end <= self.start:
            raise ValueError("end must be greater than start")
        return self


@dataclass(frozen=True)
class Route:
    """A closed route: `table` (n + 1, ROAD_SIZE), the last row is the first one lap later."""

    table: FloatArray
    spacing: float

    @property
    def length(self) -> float:
        """Length of a lap, m."""
        return self.spacing * float(self.table.shape[0] - 1)


def _curvature(segment: Segment, s: FloatArray) -> FloatArray:
    """Return the curvature, 1/m, at distances `s` from the start of the segment."""
    if segment.bend is not None:
        bend = segment.bend
        sign = math.copysign(1.0 / bend.radius, bend.angle_deg)
        if bend.transition == 0.0:
            return np.full_like(s, sign)
        ramp = np.minimum(s, bend.length - s) / bend.transition
        return sign * np.clip(ramp, 0.0, 1.0)
    if segment.slalom is not None:
        slalom = segment.slalom
        edge = np.minimum(s, slalom.length - s) / slalom.wavelength
        fade = 0.5 - 0.5 * np.cos(np.pi * np.clip(edge, 0.0, 1.0))
        wave = 2.0 * np.pi / slalom.wavelength
        return np.asarray(slalom.amplitude * wave**2 * fade * np.cos(wave * s))
    return np.zeros_like(s)


def _length(segment: Segment) -> float:
    part = segment.bend or segment.slalom
    return float(part.length if part is not None else segment.straight or 0.0)


def _trace(segments: list[Segment], lengths: list[float]) -> tuple[FloatArray, FloatArray]:
    """Return the path (n, 5): s, x, y, heading, curvature; and the heading of each straight."""
    s, curvature = [np.zeros(1)], [np.zeros(1)]
    headings = []
    begin, heading = 0.0, 0.0
    for segment, length in zip(segments, lengths, strict=True):
        local = np.linspace(0.0, length, max(2, math.ceil(length / _TRACE_STEP) + 1))
        bend = _curvature(segment, local)
        if segment.straight is not None:
            headings.append(heading)
        heading += float(np.sum(0.5 * (bend[1:] + bend[:-1]) * np.diff(local)))
        s.append(begin + local[1:])
        curvature.append(bend[1:])
        begin += length
    along, kappa = np.concatenate(s), np.concatenate(curvature)
    step = np.diff(along)
    psi = np.concatenate([[0.0], np.cumsum(0.5 * (kappa[1:] + kappa[:-1]) * step)])
    middle = 0.5 * (psi[1:] + psi[:-1])
    x = np.concatenate([[0.0], np.cumsum(np.cos(middle) * step)])
    y = np.concatenate([[0.0], np.cumsum(np.sin(middle) * step)])
    return np.column_stack([along, x, y, psi, kappa]), np.array(headings)


def build_route(
    segments: list[Segment],
    places: list[RoadPatch],
    mu: float,
    heights: list[Height] | None = None,
    undulations: list[Undulation] | None = None,
) -> Route:
    """
    Build a closed route with friction `mu` outside of `places`. The lap starts at (0, 0).

    The profile of `heights` and `undulations` is added to the grades of `places`.

    :raises ValueError: the route does not close (the bends do not turn by a whole number of
        circles, or a straight would become shorter than 5 m), or a patch or a height lies beyond
        the lap.
    """
    turned = sum(segment.bend.angle_deg for segment in segments if segment.bend is not None)
    if turned == 0.0 or abs(turned / 360.0 - round(turned / 360.0)) > 1e-9:
        raise ValueError(f"the bends must turn by whole circles in total, not by {turned:g} deg")
    lengths = [_length(segment) for segment in segments]
    straight = [i for i, segment in enumerate(segments) if segment.straight is not None]
    path, headings = _trace(segments, lengths)
    directions = np.array([np.cos(headings), np.sin(headings)])
    if len(straight) < 2 or np.linalg.matrix_rank(directions, tol=0.1) < 2:
        raise ValueError("needs straights in at least two directions to close the loop")
    for _ in range(3):
        change = np.linalg.lstsq(directions, -path[-1, 1:3], rcond=None)[0]
        for i, extra in zip(straight, change, strict=True):
            lengths[i] += float(extra)
        if min(lengths[i] for i in straight) < _MIN_STRAIGHT:
            raise ValueError("does not close: a straight would become shorter than 5 m")
        path, _ = _trace(segments, lengths)
    lap = float(path[-1, 0])
    rows = max(8, round(lap / SPACING))
    s = np.linspace(0.0, lap, rows + 1)
    table = np.zeros((rows + 1, ROAD_SIZE))
    for column in range(4):
        table[:, column] = np.interp(s, path[:, 0], path[:, column + 1])
    table[:, ROAD_MU] = mu
    table[:, ROAD_SPEED] = np.inf
    for patch in places:
        if patch.end > lap:
            raise ValueError(f"a place ends at {patch.end:g} m, but the lap has {lap:.0f} m")
        _apply_patch(table, s, patch)
    if heights or undulations:
        slope = profile_slope(heights or [], undulations or [], rows, lap)
        table[:, ROAD_GRADE] = np.arctan(np.tan(table[:, ROAD_GRADE]) + slope)
    table[-1, ROAD_CURVATURE:] = table[0, ROAD_CURVATURE:]
    table[:, ROAD_SLOPE] = np.tan(table[:, ROAD_GRADE])
    table[:, ROAD_CAMBER] = np.tan(table[:, ROAD_BANK])
    rises = 0.5 * (table[1:, ROAD_SLOPE] + table[:-1, ROAD_SLOPE]) * (lap / rows)
    table[1:, ROAD_HEIGHT] = np.cumsum(rises)
    return Route(table, lap / rows)


def similar_route(route: Route, size: float) -> Route:
    """Return a route for a vehicle at a scale of lengths: equal accelerations and slopes."""
    if size == 1.0:
        return route
    table = route.table.copy()
    table[:, [ROAD_X, ROAD_Y, ROAD_HEIGHT]] *= size
    table[:, ROAD_CURVATURE] /= size
    table[:, ROAD_SPEED] *= time_scale(size)
    return Route(table, route.spacing * size)


def _apply_patch(table: FloatArray, s: FloatArray, patch: RoadPatch) -> None:
    inside = np.minimum(s - patch.start, patch.end - s)
    share = np.clip(inside / max(patch.blend, 1e-3), 0.0, 1.0)
    for column, value in ((ROAD_MU, patch.mu), (ROAD_GRADE, patch.grade), (ROAD_BANK, patch.bank)):
        if value is not None:
            table[:, column] += share * (value - table[:, column])
    if patch.speed_max is not None:
        within = inside >= 0.0
        table[within, ROAD_SPEED] = np.minimum(table[within, ROAD_SPEED], patch.speed_max)


@strict_kernel
def lookup(table: FloatArray, spacing: float, s: float, column: int) -> float:
    """Interpolate a column at arc length `s`, m; laps wrap (not valid for ROAD_HEADING)."""
    rows = table.shape[0] - 1
    position = s / spacing
    whole = math.floor(position)
    i = int(whole) % rows
    share = position - whole
    value: float = (1.0 - share) * table[i, column] + share * table[i + 1, column]
    return value


@strict_kernel
def locate(
    table: FloatArray, spacing: float, s: float, x: float, y: float
) -> tuple[float, float, float]:
    """
    Project (x, y) on the route near arc length `s`; return (s, lateral offset, road heading).

    The offset is positive to the left, m. Two Newton steps of at most 5 m each; far from the route
    the result is approximate.
    """
    rows = table.shape[0] - 1
    across, heading = 0.0, 0.0
    for _ in range(2):
        position = s / spacing
        whole = math.floor(position)
        i = int(whole) % rows
        share = position - whole
        heading = (1.0 - share) * table[i, ROAD_HEADING] + share * table[i + 1, ROAD_HEADING]
        curvature = (1.0 - share) * table[i, ROAD_CURVATURE] + share * table[i + 1, ROAD_CURVATURE]
        dx = x - ((1.0 - share) * table[i, ROAD_X] + share * table[i + 1, ROAD_X])
        dy = y - ((1.0 - share) * table[i, ROAD_Y] + share * table[i + 1, ROAD_Y])
        along = dx * math.cos(heading) + dy * math.sin(heading)
        across = dy * math.cos(heading) - dx * math.sin(heading)
        s += min(max(along / max(1.0 - curvature * across, 0.2), -5.0), 5.0)
    return s, across, heading
