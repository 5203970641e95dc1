# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Figures of where and when simulation and recording differ: map and timeline.

The colour is the RMS residual over noise, over one second and (on the map) over the channels.
Darker is larger, so that a print in grey can be read as well.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, LogNorm

from adk_ros.mismatch.inference.result import IdentifiedEffect, MismatchResult, ResidualSeries
from adk_ros.mismatch.library.effect import PLACE
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.report.comparison_labels import residual_labels
from adk_ros.mismatch.report.vocabulary import CHANNEL_TITLES, title
from adk_ros.mismatch.surrogate.residuals import BIN_S
from adk_ros.numerics.arrays import BoolArray, FloatArray

DPI = 100
COLOURS = LinearSegmentedColormap.from_list(
    "residual", plt.get_cmap("YlOrBr")(np.linspace(0.04, 1.0, 64))
)
_SECOND = round(1.0 / BIN_S)
_LAP_STEP = 4.0
"""m, spacing of the lap's mean line."""
_MAX_RATIO = 100.0
"""Residual over noise above which the colour no longer changes."""
_HATCHES = ("////", "\\\\\\\\", "....", "xxxx")


def residual_to_noise(residuals: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the moving RMS over one second of residuals (6, b) over noise (6,), (6, b)."""
    square = (residuals / np.maximum(noise, 1e-9)[:, None]) ** 2
    kernel = np.ones(_SECOND)
    count = np.convolve(np.ones(square.shape[1]), kernel, mode="same")
    rows = [np.convolve(row, kernel, mode="same") / count for row in square]
    return np.asarray(np.sqrt(np.maximum(np.array(rows), 0.0)))


def combined_residual(residuals: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the RMS of `residual_to_noise` over the channels, (b,)."""
    return np.asarray(np.sqrt(np.mean(residual_to_noise(residuals, noise) ** 2, axis=0)))


def _scale(series: ResidualSeries) -> LogNorm:
    top = float(np.percentile(residual_to_noise(series.before, series.noise), 99.0))
    return LogNorm(1.0, float(np.clip(top, 3.0, _MAX_RATIO)))


def line_of(
    series: ResidualSeries, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (x, y, value) along the route; the mean over all laps if there are laps."""
    if series.distance is None:
        return series.x, series.y, values
    cell = np.floor(series.distance / _LAP_STEP).astype(np.int64)
    count = np.bincount(cell)
    there = count > 0
    total = count[there]

    def mean(of: FloatArray) -> FloatArray:
        sums = np.bincount(cell, of)[there] / total
        return np.append(sums, sums[0])

    return mean(series.x), mean(series.y), mean(values)


def inside(
    distance: FloatArray, segments: tuple[tuple[float, float], ...], lap: float
) -> BoolArray:
    """Return which distances along the lap lie in a segment; one may cross the lap's end."""
    within = np.zeros(distance.shape[0], dtype=np.bool_)
    for begin, end in segments:
        within |= (distance - begin) % lap <= end - begin
    return within


def map_figure(result: MismatchResult, path: Path) -> None:
    """Draw the route, coloured by the residual of the simulation, and segments of effects."""
    series = result.series
    size = combined_residual(series.before, series.noise)
    x, y, value = line_of(series, size)
    figure, axis = plt.subplots(figsize=(7.6, 5.2), constrained_layout=True)
    placed = [identified for identified in result.effects if identified.kind == PLACE]
    for identified, hatch in zip(placed, _HATCHES, strict=False):
        _mark(axis, result, identified, hatch)
    norm = _scale(series)
    axis.plot(x, y, color="0.4", linewidth=7.0, solid_capstyle="round", zorder=2.5)
    points = np.column_stack([x, y])[:, None, :]
    lines = LineCollection(
        list(np.concatenate([points[:-1], points[1:]], axis=1)),
        cmap=COLOURS,
        norm=norm,
        linewidth=5.0,
        capstyle="round",
        zorder=3,
    )
    lines.set_array(0.5 * (value[:-1] + value[1:]))
    axis.add_collection(lines)
    axis.plot(series.x[0], series.y[0], "k>", markersize=9, zorder=4)
    axis.annotate("start", (series.x[0], series.y[0]), (7, 7), textcoords="offset points")
    axis.set_aspect("equal", adjustable="datalim")
    axis.autoscale_view()
    axis.margins(0.08)
    axis.set_xlabel("x (m)")
    axis.set_ylabel("y (m)")
    axis.grid(alpha=0.25)
    if placed:
        axis.legend(loc="best", fontsize=9)
    bar = figure.colorbar(lines, ax=axis, shrink=0.8, extend="both")
    bar.set_label("RMS residual of the simulation / noise")
    bar.ax.set_yticks(*_ticks(norm))
    bar.ax.minorticks_off()
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _ticks(norm: LogNorm) -> tuple[list[float], list[str]]:
    at = [x for x in (1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 30.0, 50.0, 100.0) if norm(x) <= 1.0]
    return at, [f"{x:g}" for x in at]


def _mark(axis: Axes, result: MismatchResult, identified: IdentifiedEffect, hatch: str) -> None:
    """Draw the segments where an effect is active underneath the route."""
    series = result.series
    lap = result.lap_m
    if series.distance is None or lap is None:
        _mark_times(axis, result, identified)
        return
    along = np.arange(0.0, lap, _LAP_STEP)
    order = np.argsort(series.distance, kind="stable")
    for i, (begin, end) in enumerate(identified.segments):
        there = np.flatnonzero(inside(along, ((begin, end),), lap))
        if not there.size:
            continue
        # Ordered from the begin of the segment, which may cross the end of the lap.
        at = np.sort((along[there] - begin) % lap)
        cells = (at + begin) % lap
        x = np.interp(cells, series.distance[order], series.x[order], period=lap)
        y = np.interp(cells, series.distance[order], series.y[order], period=lap)
        label = f"{title(identified.effect.name)} active" if i == 0 else None
        dashed = hatch != _HATCHES[0]
        axis.plot(
            x,
            y,
            color="0.72" if not dashed else "0.45",
            linewidth=17.0 if not dashed else 11.0,
            linestyle="-" if not dashed else (0, (1.0, 0.6)),
            solid_capstyle="butt",
            zorder=1 if not dashed else 2,
            label=label,
        )


def _mark_times(axis: Axes, result: MismatchResult, identified: IdentifiedEffect) -> None:
    """Draw where the car is while an effect acts: with several routes there is no common lap."""
    series = result.series
    active = np.zeros(series.time_s.shape[0], dtype=bool)
    for begin, end in identified.time_intervals_s:
        active |= (series.time_s >= begin) & (series.time_s <= end)
    x, y = (np.where(active, values, np.nan) for values in (series.x, series.y))
    axis.plot(
        x,
        y,
        color="0.72",
        linewidth=17.0,
        solid_capstyle="butt",
        zorder=1,
        label=f"{title(identified.effect.name)} active",
    )


def timeline_figure(result: MismatchResult, path: Path) -> None:
    """Draw the residuals of each channel over time, and the intervals of active effects."""
    series = result.series
    rows = len(result.effects)
    figure, axes = plt.subplots(
        2 + (rows > 0),
        1,
        sharex=True,
        constrained_layout=True,
        squeeze=False,
        figsize=(10.0, 4.4 + 0.33 * rows),
        height_ratios=[0.33 * rows, 1.9, 1.9] if rows else [1.9, 1.9],
    )
    panels = list(axes[:, 0])
    if rows:
        _active_intervals(panels.pop(0), result)
    norm = _scale(series)
    span = (float(series.time_s[0]), float(series.time_s[-1]))
    for axis, residuals, heading in zip(
        panels,
        (series.before, series.after),
        residual_labels(result),
        strict=True,
    ):
        picture = axis.imshow(
            np.clip(residual_to_noise(residuals, series.noise), norm.vmin, None),
            aspect="auto",
            cmap=COLOURS,
            norm=norm,
            interpolation="nearest",
            extent=(*span, 5.5, -0.5),
        )
        axis.set_yticks(range(6), [CHANNEL_TITLES[name] for name in CHANNELS], fontsize=8)
        axis.set_title(heading, fontsize=10, loc="left")
    panels[-1].set_xlabel("time since the first message of the recording (s)")
    bar = figure.colorbar(picture, ax=panels, extend="both")
    bar.set_label("residual / noise, RMS over 1 s")
    bar.ax.set_yticks(*_ticks(norm))
    bar.ax.minorticks_off()
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _active_intervals(axis: Axes, result: MismatchResult) -> None:
    names = []
    for i, identified in enumerate(result.effects):
        spans = [(begin, end - begin) for begin, end in identified.time_intervals_s]
        axis.broken_barh(
            spans,
            (i - 0.35, 0.7),
            facecolor="0.8",
            edgecolor="black",
            hatch=_HATCHES[i % len(_HATCHES)],
            linewidth=0.8,
        )
        names.append(title(identified.effect.name))
    axis.set_yticks(range(len(names)), names, fontsize=8)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_title("effects active", fontsize=10, loc="left")
