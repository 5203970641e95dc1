# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The evidence as figures: residuals against what explains them, and errors before and after."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from adk_ros.mismatch.inference.result import IdentifiedEffect, MismatchResult
from adk_ros.mismatch.inference.segments import SpatialProfile
from adk_ros.mismatch.library.effect import PLACE
from adk_ros.mismatch.recording.sensor_log import CHANNELS, UNITS
from adk_ros.mismatch.report.location_figures import DPI
from adk_ros.mismatch.report.residual_trends import BINS, Trend
from adk_ros.mismatch.report.summary import pair_text
from adk_ros.mismatch.report.vocabulary import CHANNELS as CHANNEL_WORDS
from adk_ros.mismatch.report.vocabulary import STATES, title
from adk_ros.numerics.arrays import FloatArray

BEFORE, AFTER = "#8c2d04", "#2171b5"
"""Dark and light enough to be told apart in grey; their markers differ as well."""
_LEAST = 0.05
"""Residual over noise below which a figure's axis does not go."""


def rms(residuals: FloatArray, settled: int) -> FloatArray:
    """Return the root mean square by channel (6,) of residuals (6, b) after the settling."""
    return np.asarray(np.sqrt(np.mean(residuals[:, settled:] ** 2, axis=1)))


def profile_figure(findings: MismatchResult, found: IdentifiedEffect) -> SpatialProfile | None:
    """Return the free estimate of an effect's size along the lap, if there is one."""
    if found.kind != PLACE:
        return None
    return next((m for m in findings.profiles if m.effect == found.effect.name), None)


def trend_figure(
    findings: MismatchResult, item: Trend, found: IdentifiedEffect | None, path: Path
) -> None:
    """Draw the residual against the variable; for a place, the effect's size along the lap too."""
    sized = None if found is None else profile_figure(findings, found)
    figure, axes = plt.subplots(
        1 if sized is None else 2,
        1,
        sharex=True,
        squeeze=False,
        constrained_layout=True,
        figsize=(7.6, 3.6 if sized is None else 5.4),
        height_ratios=[1.0] if sized is None else [1.5, 1.0],
    )
    axis = axes[0, 0]
    for values, sides, colour, marker, what in (
        (item.before, item.before_sides, BEFORE, "o", "before"),
        (item.after, item.after_sides, AFTER, "s", "after"),
    ):
        axis.fill_between(item.at, sides[0], sides[1], color=colour, alpha=0.13, linewidth=0.0)
        axis.plot(
            item.at,
            values,
            color=colour,
            marker=marker,
            linewidth=1.2,
            markersize=5.0 if item.at.size <= BINS else 3.5,
            linestyle="-" if what == "before" else "--",
            markerfacecolor=colour if what == "before" else "white",
            label=what,
        )
    axis.axhline(0.0, color="black", linewidth=0.7)
    unit = UNITS[CHANNELS.index(item.channel)].replace("^", "")
    axis.set_ylabel(f"residual of {CHANNEL_WORDS[item.channel]} ({unit})", fontsize=9)
    axis.legend(fontsize=9)
    if sized is not None and found is not None:
        _size(axes[1, 0], sized, found, findings.lap_m or float(sized.at.max()))
    for each in axes[:, 0]:
        each.grid(alpha=0.3)
        if found is not None and found.kind == PLACE and findings.lap_m is not None:
            _shade(each, found, findings.lap_m)
    axes[-1, 0].set_xlabel(item.label)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _size(axis: Axes, sized: SpatialProfile, found: IdentifiedEffect, lap: float) -> None:
    """Draw the effect's size along the lap: free in each bin, and as it was fitted."""
    parameter = found.effect.parameters[0]
    axis.step(
        sized.at,
        sized.size + parameter.neutral,
        where="mid",
        color="0.45",
        linewidth=1.0,
        label="free in each bin, a first look",
    )
    along = np.linspace(0.0, lap, 1000)
    acts = np.zeros(along.shape, dtype=bool)
    for begin, end in found.segments:
        acts |= (along - begin) % lap <= end - begin
    value = found.parameters[parameter.name].value
    axis.plot(
        along,
        np.where(acts, value, parameter.neutral),
        color="black",
        linewidth=1.6,
        label="as fitted",
    )
    unit = "" if parameter.unit == "-" else f" ({parameter.unit.replace('^', '')})"
    axis.set_ylabel(
        f"{title(found.effect.name)},\n{parameter.name.replace('_', ' ')}{unit}", fontsize=9
    )
    axis.legend(fontsize=8)


def _shade(axis: Axes, found: IdentifiedEffect, lap: float) -> None:
    for begin, end in found.segments:
        for shift in (-lap, 0.0, lap):
            low, high = max(begin + shift, 0.0), min(end + shift, lap)
            if high > low:
                axis.axvspan(
                    low,
                    high,
                    facecolor="0.88",
                    edgecolor="0.5",
                    hatch="///",
                    alpha=0.6,
                    linewidth=0.0,
                    zorder=0,
                )
    axis.set_xlim(0.0, lap)


def errors_figure(findings: MismatchResult, path: Path) -> None:
    """Draw the held-out errors ahead, before and after, one panel a state."""
    figure, axes = plt.subplots(1, 3, figsize=(9.0, 2.4), constrained_layout=True)
    for axis, (name, (what, unit)) in zip(axes, STATES.items(), strict=True):
        values = (findings.before[name], findings.after[name])
        axis.set_xlabel(f"{what} ({unit})")
        if not np.isfinite(values).all():
            axis.text(0.5, 0.5, "not judged", ha="center", va="center", fontsize=9)
            axis.set_xticks([])
            axis.set_yticks([])
            continue
        bars = axis.barh(
            [0, 1],
            values,
            color=("0.35", "0.85"),
            edgecolor="black",
            hatch=("", "////"),
            height=0.65,
        )
        axis.bar_label(bars, pair_text(*values), padding=3, fontsize=9)
        axis.set_yticks([0, 1], ["before", "after"])
        axis.invert_yaxis()
        axis.set_xlim(0.0, 1.3 * max(*values, 1e-9))
        axis.locator_params(axis="x", nbins=4)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def unexplained_figure(before: FloatArray, after: FloatArray, path: Path) -> None:
    """Draw residual over noise (6,) by channel, before and after; one is the noise."""
    figure, axis = plt.subplots(figsize=(7.6, 2.9), constrained_layout=True)
    rows = np.arange(6)
    first, second = np.maximum(before, _LEAST), np.maximum(after, _LEAST)
    axis.hlines(rows, np.minimum(first, second), np.maximum(first, second), color="0.6", zorder=1)
    axis.plot(first, rows, "o", color=BEFORE, markersize=8, label="before")
    axis.plot(second, rows, "s", color=AFTER, markersize=8, markerfacecolor="white", label="after")
    axis.axvline(1.0, color="black", linewidth=1.0, linestyle=":", label="noise")
    axis.set_xscale("log")
    low, high = min(0.7, 0.8 * float(second.min())), max(3.0, 1.4 * float(first.max()))
    axis.set_xlim(low, high)
    marks = [x for x in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500) if low <= x <= high]
    axis.set_xticks(marks, [f"{x:g}" for x in marks])
    axis.minorticks_off()
    axis.set_yticks(rows, [CHANNEL_WORDS[name] for name in CHANNELS], fontsize=9)
    axis.invert_yaxis()
    axis.set_xlabel("RMS residual in 40 ms / noise")
    axis.grid(alpha=0.3, axis="x")
    axis.legend(fontsize=9)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
