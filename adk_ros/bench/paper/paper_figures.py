# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures 4 to 9 of the paper and the summary figure; they need no display."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from adk_ros.bench.paper.cases import CLEAN, NOMINAL
from adk_ros.bench.paper.claims import Series
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    ALDK,
    DK,
    FFRLS,
    LINEAR,
    LINEAR_ADAPTED,
    MF,
    MF_TUNED,
    ORACLE,
    PYKOOP,
    PYKOOPMAN,
    RLS,
    SWLS,
)
from adk_ros.bench.paper.ratios import geometric_means
from adk_ros.bench.paper.scores import CHANNELS, HORIZONS, UNITS, ScoreTable
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.score import HORIZON_STEPS, REPORT_SCALE, TICK_S

PLANNED = {
    "figure_4": (NOMINAL, (DK, ALDK), "Figure 4: the acceleration loss"),
    "figure_5": (NOMINAL, (MF, ALDK, RLS, FFRLS, SWLS), "Figure 5: five approaches"),
    "figure_6a": ("mass_plus_160", (MF, ALDK, RLS, FFRLS, SWLS), "Figure 6a: +160 kg"),
    "figure_6b": ("mass_minus_170", (MF, ALDK, RLS, FFRLS, SWLS), "Figure 6b: -170 kg"),
    "figure_7a": ("inertia_plus_142", (MF, ALDK, RLS, FFRLS, SWLS), "Figure 7a: +142 kg·m²"),
    "figure_7b": ("inertia_minus_158", (MF, ALDK, RLS, FFRLS, SWLS), "Figure 7b: -158 kg·m²"),
    "figure_8": ("mountain", (MF, ALDK, RLS, FFRLS, SWLS), "Figure 8: mountain road"),
    "figure_9": ("slalom", (MF, ALDK, RLS, FFRLS, SWLS), "Figure 9: slalom test road"),
}
"""File -> test, predictors of the paper, title; adk_ros is added to each."""

# The palette of Okabe and Ito, which colour-blind readers can distinguish, with line styles.
STYLES: dict[str, tuple[str, str]] = {
    DK: ("#CC79A7", "-"), MF: ("#999999", "-"), ALDK: ("#E69F00", "-"), RLS: ("#56B4E9", "--"),
    FFRLS: ("#009E73", "--"), SWLS: ("#0072B2", "-"), ADK_ROS: ("#D55E00", "-"),
    PYKOOP: ("#009E73", "-"), PYKOOPMAN: ("#009E73", "--"), MF_TUNED: ("#999999", "--"),
    LINEAR: ("#56B4E9", ":"), LINEAR_ADAPTED: ("#56B4E9", ":"), ORACLE: ("#000000", ":"),
}  # fmt: skip
_SUMMARY = (DK, ALDK, SWLS, MF_TUNED, LINEAR_ADAPTED, PYKOOP, PYKOOPMAN, ADK_ROS, ORACLE)
_AVERAGED_STEPS = 40
_MIN_RATIO, _MAX_RATIO = 3e-3, 50.0
"""Limits of the ratio axis; fixed, so that the figures of two runs can be compared."""
_LABEL_HEIGHT = 0.045
"""Height of a label relative to the axes."""
_LABEL_ITERATIONS = 500
_BEST_NAIVE = "best naive predictor"


def write_figures(board: ScoreTable, series: Series, folder: Path) -> dict[str, Path]:
    """Write all figures that have data; return title -> path."""
    written = {}
    for name, (test, predictors, title) in PLANNED.items():
        lines = _lines(series, test, [*predictors, ADK_ROS])
        if lines:
            written[title] = folder / f"{name}.png"
            history_figure(lines, title, written[title])
    title = "Summary: RMSE divided by that of the best naive predictor, by horizon"
    written[title] = folder / "summary.png"
    summary_figure(board, written[title])
    return written


def _lines(series: Series, test: str, names: Sequence[str]) -> dict[str, tuple[FloatArray, ...]]:
    found = {}
    for name in names:
        try:
            found[name] = series(test, name)
        except KeyError:
            continue
    return found


def history_figure(lines: dict[str, tuple[FloatArray, ...]], title: str, path: Path) -> None:
    """Draw truth and one-step predictions on the left, their errors on the right."""
    figure, axes = plt.subplots(3, 2, figsize=(13, 8), sharex=True, constrained_layout=True)
    for c in range(3):
        left, right = axes[c]
        time_s, truth, _ = next(iter(lines.values()))
        low, high = truth[:, c].min() * REPORT_SCALE[c], truth[:, c].max() * REPORT_SCALE[c]
        for name, (time_s, truth, predicted) in lines.items():
            colour, dashes = STYLES[name]
            width = 1.3 if name == ADK_ROS else 0.8
            shown = np.nan_to_num(predicted[:, c], nan=np.inf) * REPORT_SCALE[c]
            left.plot(time_s, shown, color=colour, linestyle=dashes, linewidth=width, label=name)
            error = (predicted[:, c] - truth[:, c]) * REPORT_SCALE[c]
            right.plot(
                time_s, _averaged(error), color=colour, linestyle=dashes, linewidth=width,
                label=name,
            )  # fmt: skip
        left.plot(
            time_s, truth[:, c] * REPORT_SCALE[c], color="black", linewidth=0.9, linestyle=":",
            label="truth",
        )  # fmt: skip
        # Limits follow the truth: a diverged prediction would otherwise hide it.
        room = 0.15 * max(high - low, 1e-6)
        left.set_ylim(low - room, high + room)
        left.set_ylabel(f"{CHANNELS[c]} ({UNITS[c]})")
        right.set_yscale("log")
        right.set_ylabel(f"error of {CHANNELS[c]} ({UNITS[c]})")
        for axis in (left, right):
            axis.grid(alpha=0.3)
            axis.margins(x=0.01)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9)
    axes[2, 0].set_xlabel("time (s)")
    axes[2, 1].set_xlabel("time (s)")
    axes[0, 0].set_title("one step (25 ms) ahead")
    axes[0, 1].set_title("error, RMS over 1 s")
    figure.suptitle(title)
    figure.savefig(path, dpi=75)
    plt.close(figure)


def _averaged(error: FloatArray) -> FloatArray:
    """Return the moving RMS over one second; NaN where a prediction is not finite."""
    square = np.convolve(error**2, np.full(_AVERAGED_STEPS, 1.0 / _AVERAGED_STEPS), mode="same")
    return np.asarray(np.sqrt(np.maximum(square, 1e-18)))


def summary_figure(board: ScoreTable, path: Path) -> None:
    """Draw the geometric mean of the RMSE over that of the best naive predictor, by horizon."""
    variants = board.variants()
    figure, axes = plt.subplots(
        1, len(variants), figsize=(6.2 * len(variants), 5.2), sharey=True, squeeze=False,
        constrained_layout=True,
    )  # fmt: skip
    for axis, variant in zip(axes[0], variants, strict=True):
        _by_horizon(axis, board, variant)
    axes[0, 0].set_ylabel("RMSE / RMSE of the best naive predictor")
    tests = len(board.tests())
    figure.suptitle(f"Geometric mean over {tests} tests and 3 channels; below 1 is better")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def _by_horizon(axis: Axes, board: ScoreTable, variant: str) -> None:
    """Draw one line per predictor, labelled at its end."""
    horizon_s = np.array(HORIZON_STEPS) * TICK_S
    ends: dict[str, float] = {}
    for name in [name for name in _SUMMARY if board.has(name)]:
        means = geometric_means(board, name)
        values = np.array([means.get((variant, i), np.nan) for i in range(len(HORIZONS))])
        if np.isnan(values).all():
            continue
        colour, dashes = STYLES[name]
        axis.plot(
            horizon_s, values, color=colour, linestyle=dashes, marker="o", markersize=4,
            linewidth=3.0 if name == ADK_ROS else 1.4, zorder=3 if name == ADK_ROS else 2,
        )  # fmt: skip
        ends[name] = float(np.clip(values[-1], _MIN_RATIO, _MAX_RATIO))
    axis.axhline(1.0, color="black", linewidth=0.8)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlim(0.02, 2.4)
    axis.set_ylim(_MIN_RATIO, _MAX_RATIO)
    axis.set_xticks(horizon_s, [f"{value:g}" for value in horizon_s])
    axis.minorticks_off()
    axis.set_xlabel("prediction horizon (s)")
    axis.set_title(f"from {'exact' if variant == CLEAN else 'noisy'} measurements ({variant})")
    axis.grid(alpha=0.3)
    ends[_BEST_NAIVE] = 1.0
    for name, (at, height) in zip(ends, _apart(list(ends.values())), strict=True):
        off = " (off scale)" if at >= _MAX_RATIO else ""
        axis.annotate(
            f"{name}{off}", (2.4, height), (4, 0), textcoords="offset points", va="center",
            color=STYLES.get(name, ("black", "-"))[0], fontsize=9, annotation_clip=False,
            fontweight="bold" if name == ADK_ROS else "normal",
        )  # fmt: skip


def _apart(values: Sequence[float]) -> list[tuple[float, float]]:
    """Return each value with a label height: in the order of the values, without overlap."""
    low, high = np.log10(_MIN_RATIO), np.log10(_MAX_RATIO)
    gap = _LABEL_HEIGHT * (high - low)
    order = np.argsort(values, kind="stable")
    heights = np.log10(np.asarray(values, dtype=np.float64))[order]
    for _ in range(_LABEL_ITERATIONS):
        short = np.maximum(gap - np.diff(heights), 0.0)
        if not short.any():
            break
        heights[1:] += 0.5 * short
        heights[:-1] -= 0.5 * short
        heights = np.clip(heights, low, high)
    placed = np.empty(len(heights))
    placed[order] = 10.0**heights
    return list(zip(values, placed.tolist(), strict=True))
