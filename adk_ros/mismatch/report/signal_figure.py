# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Signals over time, measured and predicted, with their residuals: figure and table of fits."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt

from adk_ros.files.pages.figure_style import AFTER, BEFORE, BLACK
from adk_ros.mismatch.inference.signal_fit import SIGNAL_UNITS, SIGNALS, PredictedSignals
from adk_ros.mismatch.report.location_figures import DPI
from adk_ros.mismatch.report.vocabulary import unit_text
from adk_ros.numerics.arrays import FloatArray

SHOWN_S = 40.0
"""s of the data that the figure shows: longer, and single bends cannot be read."""
TITLES = {
    "v_x": "speed v_x",
    "v_y": "lateral velocity v_y",
    "yaw_rate": "yaw rate",
    "a_x": "longitudinal acceleration a_x",
    "a_y": "lateral acceleration a_y",
}


_MAX_STEPS = 2.5
"""Steps between two predictions above which a line would cross missing data. By choice."""


def shown_until(signals: PredictedSignals) -> float:
    """Return the end of the time range of the figure, s."""
    return float(min(signals.time_s[-1], signals.time_s[0] + SHOWN_S))


def signals_figure(signals: PredictedSignals, labels: tuple[str, str], path: Path) -> None:
    """Draw each signal and, below it, measured minus predicted."""
    fits = signals.fits()
    names = [name for name in SIGNALS if math.isfinite(fits[name][0])]
    figure, axes = plt.subplots(
        2 * len(names),
        1,
        sharex=True,
        squeeze=False,
        figsize=(9.0, 2.6 * len(names) + 0.6),
        height_ratios=[2.0, 1.0] * len(names),
        constrained_layout=True,
    )
    shown = signals.time_s <= shown_until(signals)
    at_s = signals.time_s[shown]
    # No line crosses a gap, a standstill or what is left out.
    apart = np.diff(at_s, prepend=at_s[0]) > _MAX_STEPS * float(np.median(np.diff(at_s)))
    for i, name in enumerate(names):
        k = SIGNALS.index(name)
        upper, lower = axes[2 * i, 0], axes[2 * i + 1, 0]
        measured = np.where(apart, np.nan, signals.measured[k][shown])
        unit = unit_text(SIGNAL_UNITS[k])
        upper.plot(at_s, measured, color=BLACK, linewidth=1.8, label="measured")
        for values, colour, line, label in (
            (signals.simulation, BEFORE, "--", labels[0]),
            (signals.corrected, AFTER, "-", labels[1]),
        ):
            predicted = np.where(apart, np.nan, values[k][shown])
            upper.plot(at_s, predicted, color=colour, linestyle=line, linewidth=1.1, label=label)
            lower.plot(at_s, measured - predicted, color=colour, linestyle=line, linewidth=0.9)
        lower.axhline(0.0, color="black", linewidth=0.6)
        before, after, _ = fits[name]
        upper.set_title(
            f"{TITLES[name]}: fit {before:.1f} % ({labels[0]}), {after:.1f} % ({labels[1]})",
            fontsize=10,
            loc="left",
        )
        upper.set_ylabel(unit, fontsize=9)
        lower.set_ylabel(f"residual\n({unit})", fontsize=8)
        lower.set_ylim(*_symmetric(signals.measured[k] - signals.simulation[k]))
        for axis in (upper, lower):
            axis.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("time (s)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    figure.align_ylabels()
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _symmetric(residual: FloatArray) -> tuple[float, float]:
    """Return limits that hold all but the largest hundredth of a residual."""
    top = 1.2 * float(np.nanpercentile(np.abs(residual), 99.0))
    return -max(top, 1e-6), max(top, 1e-6)


def fit_rows(signals: PredictedSignals) -> list[list[str]]:
    """Return signal, fit of simulation and corrected model, and that of a perfect model."""
    rows = []
    for name, values in signals.fits().items():
        if not math.isfinite(values[0]):
            rows.append([TITLES[name], "not evaluated", "", ""])
            continue
        rows.append([TITLES[name], *(f"{x:.1f} %" for x in values)])
    return rows
