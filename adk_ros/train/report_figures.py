# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of reports; no screen is needed."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt

from adk_ros.signals.channels import STATE_NAMES, TICK_NS
from adk_ros.signals.score import REPORT_SCALE
from adk_ros.train.held_out import HELD_INPUTS, MODEL, HeldOutScores

_LABELS = ("v_x (km/h)", "v_y (km/h)", "yaw rate (deg/s)")
_AHEAD = 40


def prediction_figure(test: HeldOutScores, path: Path, longest_s: float = 40.0) -> None:
    """Measured, predicted 1 s ahead and its naive rival's error along the longest stretch."""
    rolled = max(test.rollouts, key=lambda item: item.rows.size)
    record, rows = rolled.record, rolled.rows
    # A stretch without a break, and not longer than can be read.
    breaks = np.flatnonzero(np.diff(rows) > 40)
    edges = np.concatenate([[0], breaks + 1, [rows.size]])
    widest = int(np.argmax(np.diff(edges)))
    chosen = np.arange(edges[widest], edges[widest + 1])
    since_s = (rows[chosen] - rows[chosen[0]]) * TICK_NS * 1e-9
    chosen = chosen[since_s <= longest_s]
    target = rows[chosen] + _AHEAD
    time_s = (record.stamp_ns[target] - record.stamp_ns[target[0]]) * 1e-9
    measured = record.x_ref[target] * REPORT_SCALE
    ours = rolled.predicted[chosen, _AHEAD - 1] * REPORT_SCALE
    naive = record.x[rows[chosen]] * REPORT_SCALE
    figure, axes = plt.subplots(3, 2, figsize=(12, 7.5), sharex=True, constrained_layout=True)
    for c in range(3):
        left, right = axes[c]
        left.plot(time_s, measured[:, c], color="black", linewidth=1.6, label="measured")
        left.plot(
            time_s, ours[:, c], color="tab:blue", linewidth=1.1, label="predicted 1 s before"
        )
        left.set_ylabel(_LABELS[c])
        right.plot(
            time_s,
            naive[:, c] - measured[:, c],
            color="tab:orange",
            linewidth=0.9,
            label="persistence",
        )
        right.plot(time_s, ours[:, c] - measured[:, c], color="tab:blue", label="model")
        right.axhline(0.0, color="black", linewidth=0.5)
        right.set_ylabel(f"error, {_LABELS[c]}")
        for axis in (left, right):
            axis.grid(alpha=0.3)
    axes[0, 0].legend(loc="best", fontsize=8)
    axes[0, 1].legend(loc="best", fontsize=8)
    axes[2, 0].set_xlabel("time (s)")
    axes[2, 1].set_xlabel("time (s)")
    figure.suptitle(f"{record.name}: predicted 1 s ahead under known commands, not trained on")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def horizon_figure(test: HeldOutScores, path: Path) -> None:
    """RMSE against the horizon, all predictors, one panel a channel."""
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.8), constrained_layout=True)
    steps = np.array(test.scores[MODEL].steps) * TICK_NS * 1e-9
    for c, axis in enumerate(axes):
        for name, item in test.scores.items():
            ours = name in (MODEL, HELD_INPUTS)
            axis.plot(
                steps,
                item.rmse[:, c] * REPORT_SCALE[c],
                marker="o",
                markersize=3,
                linestyle="-" if ours else "--",
                linewidth=1.8 if ours else 1.0,
                label=name,
            )
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("horizon (s)")
        axis.set_ylabel(f"RMSE, {_LABELS[c]}")
        axis.set_title(STATE_NAMES[c])
        axis.grid(alpha=0.3, which="both")
    axes[0].legend(fontsize=7)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def curve_figure(curve: list[tuple[int, float, float]], best_step: int, path: Path) -> None:
    """Training and validation loss by step."""
    table = np.array(curve)
    figure, axis = plt.subplots(figsize=(7, 3.6), constrained_layout=True)
    axis.plot(table[:, 0], table[:, 1], label="training (short, then long roll-outs)")
    axis.plot(table[:, 0], table[:, 2], label="validation, full roll-out")
    axis.axvline(best_step, color="black", linewidth=0.7, linestyle=":", label="state kept")
    axis.set_yscale("log")
    axis.set_xlabel("step")
    axis.set_ylabel("loss (1 = persistence)")
    axis.grid(alpha=0.3, which="both")
    axis.legend()
    figure.savefig(path, dpi=110)
    plt.close(figure)
