# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a fleet's page: vehicles and effects, trends, the map of places."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import cycle
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from adk_ros.files.pages.figure_style import BLUE, GREY, ORANGE, PURPLE, VERMILION
from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.fleet_result import FleetResult, TrendPoint, VehicleEffect
from adk_ros.mismatch.report.effect_text import number
from adk_ros.mismatch.report.vocabulary import title, unit_text
from adk_ros.numerics.arrays import FloatArray, IntArray

_DPI = 110
_LIMIT = 5.0
"""Colours of the matrix saturate at this many materiality thresholds."""


def matrix_figure(result: FleetResult, path: Path) -> None:
    """Draw the vehicle x effect matrix in materiality thresholds; claimed entries are framed."""
    keys = list(dict.fromkeys((v.effect, v.parameter) for v in result.vehicles))
    entries = {(v.car, (v.effect, v.parameter)): v for v in result.vehicles}
    values = np.array(
        [[entries[car, key].thresholds for key in keys] for car in result.cars],
    )
    width, height = 2.4 + 0.95 * len(keys), 1.9 + 0.33 * len(result.cars)
    figure, axes = plt.subplots(figsize=(max(width, 5.0), height), layout="constrained")
    image = axes.imshow(values, cmap="RdBu_r", vmin=-_LIMIT, vmax=_LIMIT, aspect="auto")
    for i, car in enumerate(result.cars):
        for j, key in enumerate(keys):
            entry = entries[car, key]
            dark = abs(values[i, j]) > 0.6 * _LIMIT
            axes.text(
                j,
                i,
                _entry_text(entry),
                ha="center",
                va="center",
                fontsize=6.5,
                color="w" if dark else "k",
            )
            if entry.is_claimed:
                box = Rectangle((j - 0.47, i - 0.45), 0.94, 0.9, fill=False, lw=1.6)
                axes.add_patch(box)
    labels = [
        f"{title(effect)}\n{name} {unit_text(column_of(f'{effect}.{name}').parameter.unit)}"
        for effect, name in keys
    ]
    axes.set_xticks(range(len(keys)), labels, rotation=35, ha="right", fontsize=7.5)
    axes.set_yticks(range(len(result.cars)), result.cars, fontsize=8)
    figure.colorbar(image, ax=axes, label="materiality thresholds")
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)


def _entry_text(entry: VehicleEffect) -> str:
    """Return the size of a parameter in a car with its interval."""
    p = column_of(f"{entry.effect}.{entry.parameter}").parameter
    if not p.inverse:
        half = 0.5 * (entry.high - entry.low)
        return f"{number(entry.size, 2.0 * half)}\n±{number(half, half)}"
    # A car may have no limit: its value is infinite.
    if entry.low > p.high:
        return "none"
    if entry.high > p.high:
        return f"at least\n{number(entry.low, 0.1 * entry.low)}"
    width = entry.high - entry.low
    size, low, high = (number(x, width) for x in (entry.size, entry.low, entry.high))
    return f"{size}\n{low} to {high}"


def trend_figure(
    points: Sequence[TrendPoint], unit: str, cars: Collection[str], path: Path
) -> None:
    """
    Draw the sizes of one parameter by recording over time, with the claimed trends.

    `cars` have claims besides those of the fleet: each has its line.
    """
    figure, axes = plt.subplots(figsize=(7.5, 3.0), layout="constrained")
    ordered = sorted(points, key=lambda p: p.day)
    days = [p.day for p in ordered]
    values = np.array([(p.size, p.low, p.high, p.fitted) for p in ordered])
    parameter = column_of(f"{points[0].effect}.{points[0].parameter}").parameter
    if parameter.inverse:
        # A recording without a limit, whose value is infinite, is above the figure.
        finite = values[:, [0, 3]][values[:, [0, 3]] <= parameter.high]
        top = 1.3 * float(finite.max(initial=0.0)) or parameter.high
        values = np.minimum(values, 2.0 * top)
        axes.set_ylim(0.0, top)
    size, low, high, fitted = values.T
    axes.errorbar(
        days,
        size,
        yerr=[size - low, high - size],
        fmt="o",
        ms=4,
        color=BLUE,
        ecolor=GREY,
        label="one recording (90 % interval of its noise)",
    )
    groups = [point.car if point.car in cars else "" for point in ordered]
    colours = cycle((VERMILION, ORANGE, PURPLE))
    for group in dict.fromkeys(groups):
        rows = [i for i, each in enumerate(groups) if each == group]
        label = group or ("the other cars" if cars else "all cars")
        line = [days[i] for i in rows], fitted[rows]
        axes.plot(*line, color=next(colours), marker=".", ms=3, label=label)
    axes.set_xlabel("day")
    axes.set_ylabel(f"{title(points[0].effect)}, {unit_text(unit)}")
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)


def map_figure(result: FleetResult, path: Path) -> None:
    """
    Draw the cells that several recordings pass, and the claimed places.

    Regions of the map that are far apart are drawn side by side.
    """
    visited = np.array(result.visited, dtype=np.float64).reshape(-1, 3)
    regions = _regions(visited[:, :2])
    count = max(len(regions), 1)
    figure, panels = plt.subplots(
        1, count, figsize=(max(3.6 * count, 4.0), 3.8), layout="constrained", squeeze=False
    )
    colours = (VERMILION, ORANGE, PURPLE, BLUE)
    for axes, rows in zip(panels[0], regions, strict=False):
        part = visited[rows]
        image = axes.scatter(
            part[:, 0], part[:, 1], c=part[:, 2], s=12, marker="s", cmap="Greys", vmin=0
        )
        for i, place in enumerate(result.places):
            centres = np.array(place.centres)
            near = np.abs(centres[:, None] - part[None, :, :2]).max(axis=2).min(axis=1) < 1.0
            if near.any():
                axes.scatter(
                    centres[near, 0],
                    centres[near, 1],
                    s=42,
                    marker="s",
                    color=colours[i % len(colours)],
                    label=title(place.effect),
                )
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=8)
        axes.set_aspect("equal", "datalim")
        axes.set_xlabel("x, m")
        axes.tick_params(labelsize=7)
    panels[0, 0].set_ylabel("y, m")
    if regions:
        figure.colorbar(image, ax=panels[0, -1], label="recordings")
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)


_REGION_M = 1000.0
"""Distance between regions of the map that are drawn apart, m. By choice."""


def _regions(centres: FloatArray) -> list[IntArray]:
    """
    Return the rows of each connected region of the map: of centres (n, 2), m.

    Centres in the same square of the distance's size are connected; squares that touch each other
    are, if two of their centres are near enough.
    """
    if not len(centres):
        return []
    squares, square_of = np.unique(
        np.floor(centres / _REGION_M).astype(np.int64), axis=0, return_inverse=True
    )
    square_of = square_of.reshape(-1)
    groups = _rows_by(square_of)
    numbers = {(int(x), int(y)): number for number, (x, y) in enumerate(squares)}
    trees = [cKDTree(centres[rows]) for rows in groups]
    pairs = []
    for (x, y), one in numbers.items():
        for beside in ((x + 1, y - 1), (x + 1, y), (x + 1, y + 1), (x, y + 1)):
            other = numbers.get(beside)
            if other is None:
                continue
            distances, _ = trees[one].query(centres[groups[other]], p=np.inf)
            if distances.min() < _REGION_M:
                pairs.append((one, other))
    ones, others = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    graph = coo_matrix((np.ones(len(ones)), (ones, others)), shape=(len(groups),) * 2)
    _, region_of = connected_components(graph, directed=False)
    regions = _rows_by(region_of[square_of])
    return sorted(regions, key=lambda rows: float(centres[rows, 0].mean()))


def _rows_by(numbers: IntArray) -> list[IntArray]:
    """Return the rows of each number from 0 on, all of which occur."""
    ends = np.cumsum(np.bincount(numbers))[:-1]
    return np.split(np.argsort(numbers, kind="stable"), ends)
