# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figure of `adk bench range`: the ratio to the best naive predictor against speed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from adk_ros.bench.runtime.range_bench import MAX_RATIO, REVERSING, STOP_AND_GO, RangeCase
from adk_ros.signals.score import HORIZON_STEPS, TICK_S

_NAMES = ("v_x", "v_y", "yaw rate")
_TICKS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


def range_figure(cases: Sequence[RangeCase]) -> Figure:
    """Return the figure: a panel by variant, the largest ratio over the horizons by channel."""
    by_variant: dict[str, list[RangeCase]] = {}
    for case in cases:
        if case.variant not in (STOP_AND_GO, REVERSING):
            by_variant.setdefault(case.variant, []).append(case)
    figure = Figure(figsize=(3.2 * len(by_variant), 3.9), layout="constrained")
    axes = figure.subplots(1, len(by_variant), sharey=True, squeeze=False)[0]
    for ax, (variant, members) in zip(axes, by_variant.items(), strict=True):
        speeds = [case.speed_kmh for case in members]
        for c, name in enumerate(_NAMES):
            known = [float(np.max(case.known[:, c])) for case in members]
            held = [float(np.max(case.held[:, c])) for case in members]
            (line,) = ax.plot(speeds, known, marker="o", markersize=3, label=name)
            ax.plot(speeds, held, linestyle=":", color=line.get_color())
        ax.axhline(MAX_RATIO, color="0.5", linewidth=0.8)
        ax.set_title(variant, fontsize=9)
        ax.set_xlabel(f"top speed (km/h)\n{_peaks(members)}", fontsize=8)
        ax.set_yscale("log")
        ax.yaxis.set_major_locator(FixedLocator(_TICKS))
        ax.yaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_minor_locator(NullLocator())
    first, last = HORIZON_STEPS[0] * TICK_S, HORIZON_STEPS[-1] * TICK_S
    axes[0].set_ylabel("RMSE / best naive predictor's")
    axes[0].legend(fontsize=8, frameon=False, loc="lower right")
    figure.suptitle(
        f"Largest ratio over horizons of {first:g} to {last:g} s; solid: commands known, dotted: "
        "held\nBelow: largest steering angle, sideslip angle and lateral acceleration of a drive",
        fontsize=9,
    )
    return figure


def _peaks(cases: Sequence[RangeCase]) -> str:
    """Return how hard the drives are: a slalom in which the car would spin is steered less."""
    steering, angle, accel = np.array([case.peak for case in cases]).T
    return (
        f"steering {steering.min():.3f} to {steering.max():.3f} rad\n"
        f"sideslip {np.rad2deg(angle.min()):.1f} to {np.rad2deg(angle.max()):.1f}°, "
        f"a_y {accel.min():.1f} to {accel.max():.1f} m/s²"
    )


def write_range_figure(cases: Sequence[RangeCase], path: Path) -> None:
    """Write the figure as PNG, SVG or PDF, by the file's suffix."""
    range_figure(cases).savefig(path, dpi=150)
