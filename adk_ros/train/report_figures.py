# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of the model report; they need no display."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt

from adk_ros.files.pages.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILION,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES, TICK_NS
from adk_ros.signals.score import DISPLAY_NAMES, REPORT_SCALE
from adk_ros.train.held_out import HELD_INPUTS, MODEL, HeldOutScores


class FigureUnits(NamedTuple):
    """Units of a figure: factors (3,) on SI values, and the label of each channel."""

    scale: FloatArray
    labels: tuple[str, str, str]


REPORT_UNITS = FigureUnits(REPORT_SCALE, ("v_x (km/h)", "v_y (km/h)", "yaw rate (deg/s)"))
SI_UNITS = FigureUnits(np.ones(3), ("v_x (m/s)", "v_y (m/s)", "yaw rate (rad/s)"))
_AHEAD = 40
"""Steps of 25 ms: 1 s."""
_GAP_ROWS = 40
"""Rows between two rollouts from which they belong to different sections."""
_LABELS = {
    MODEL: "model, future commands known",
    HELD_INPUTS: "model, commands held constant",
} | DISPLAY_NAMES
_STYLES = {
    MODEL: (BLUE, "-", "o"),
    HELD_INPUTS: (VERMILION, "-", "s"),
    "persistence": (GREY, "--", "^"),
    "straight line": (ORANGE, "-.", "v"),
    "IMU integration": (GREEN, ":", "D"),
}
_OTHER_STYLES = ((PURPLE, "--", "x"), (SKY_BLUE, "-.", "+"), (BLACK, ":", "*"))


def predictor_label(name: str) -> str:
    """Return how a predictor of the scores is called in tables and figures."""
    return _LABELS.get(name, name)


def prediction_figure(
    test: HeldOutScores,
    path: Path,
    longest_s: float = 40.0,
    units: FigureUnits = REPORT_UNITS,
) -> None:
    """Draw measurement and 1 s prediction, and errors of model and persistence, of one section."""
    rollouts = max(test.rollouts, key=lambda item: item.rows.size)
    record, rows = rollouts.record, rollouts.rows
    # The longest section without a gap, up to the length that remains readable.
    breaks = np.flatnonzero(np.diff(rows) > _GAP_ROWS)
    edges = np.concatenate([[0], breaks + 1, [rows.size]])
    longest = int(np.argmax(np.diff(edges)))
    chosen = np.arange(edges[longest], edges[longest + 1])
    elapsed_s = (rows[chosen] - rows[chosen[0]]) * TICK_NS * 1e-9
    chosen = chosen[elapsed_s <= longest_s]
    target = rows[chosen] + _AHEAD
    time_s = (record.stamp_ns[target] - record.stamp_ns[target[0]]) * 1e-9
    measured = record.x_ref[target] * units.scale
    predicted = rollouts.predicted[chosen, _AHEAD - 1] * units.scale
    persistence = record.x[rows[chosen]] * units.scale
    figure, axes = plt.subplots(3, 2, figsize=(12, 7.5), sharex=True, constrained_layout=True)
    for c in range(3):
        left, right = axes[c]
        left.plot(time_s, measured[:, c], color=BLACK, linewidth=1.6, label="measured")
        left.plot(
            time_s,
            predicted[:, c],
            color=BLUE,
            linestyle="--",
            linewidth=1.2,
            label="predicted 1 s ahead",
        )
        left.set_ylabel(units.labels[c])
        right.plot(
            time_s,
            persistence[:, c] - measured[:, c],
            color=ORANGE,
            linestyle="-.",
            linewidth=1.0,
            label="persistence",
        )
        right.plot(
            time_s, predicted[:, c] - measured[:, c], color=BLUE, linewidth=1.2, label="model"
        )
        right.axhline(0.0, color=BLACK, linewidth=0.5)
        right.set_ylabel(f"error of {units.labels[c]}")
        for axis in (left, right):
            axis.grid(alpha=0.3)
    axes[0, 0].legend(loc="best", fontsize=8)
    axes[0, 1].legend(loc="best", fontsize=8)
    axes[2, 0].set_xlabel("time (s)")
    axes[2, 1].set_xlabel("time (s)")
    figure.suptitle(f"{record.name}: 1 s ahead on held-out data, future commands known")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def horizon_figure(test: HeldOutScores, path: Path, units: FigureUnits = REPORT_UNITS) -> None:
    """Draw the RMSE of all predictors over the horizon, one panel per channel."""
    figure, axes = plt.subplots(1, 3, figsize=(12, 4.4), constrained_layout=True)
    horizon_s = np.array(test.scores[MODEL].steps) * TICK_NS * 1e-9
    others = iter(_OTHER_STYLES)
    styles = {name: _STYLES.get(name) or next(others) for name in test.scores}
    for c, axis in enumerate(axes):
        if np.isnan(test.ratio[:, c]).all():
            axis.set_axis_off()
            axis.text(0.5, 0.5, f"{STATE_NAMES[c]} is not measured", ha="center")
            continue
        for name, item in test.scores.items():
            colour, line, marker = styles[name]
            is_model = name in (MODEL, HELD_INPUTS)
            axis.plot(
                horizon_s,
                item.rmse[:, c] * units.scale[c],
                color=colour,
                linestyle=line,
                marker=marker,
                markersize=5,
                linewidth=1.8 if is_model else 1.2,
                label=predictor_label(name),
            )
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xticks(horizon_s, [f"{value:g}" for value in horizon_s])
        axis.minorticks_off()
        axis.set_xlabel("prediction horizon (s)")
        axis.set_ylabel(f"RMSE of {units.labels[c]}")
        axis.grid(alpha=0.3, which="both")
    drawn = [axis.get_legend_handles_labels() for axis in axes if axis.lines]
    for handles, labels in drawn[:1]:
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def curve_figure(curve: list[tuple[int, float, float]], best_step: int, path: Path) -> None:
    """Draw training and validation loss over the training steps."""
    table = np.array(curve)
    figure, axis = plt.subplots(figsize=(7, 3.6), constrained_layout=True)
    axis.plot(
        table[:, 0],
        table[:, 1],
        color=ORANGE,
        label="training (rollouts of increasing length)",
    )
    axis.plot(
        table[:, 0], table[:, 2], color=BLUE, linestyle="--", label="validation (full rollouts)"
    )
    axis.axvline(best_step, color=BLACK, linewidth=0.9, linestyle=":", label="selected checkpoint")
    axis.set_yscale("log")
    axis.set_xlabel("training step")
    axis.set_ylabel("loss (1: persistence)")
    axis.grid(alpha=0.3, which="both")
    axis.legend()
    figure.savefig(path, dpi=110)
    plt.close(figure)
