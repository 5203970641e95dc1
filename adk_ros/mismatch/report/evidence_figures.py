# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of the evidence: residual trends, and errors of simulation and corrected model."""

from __future__ import annotations

import textwrap
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from adk_ros.files.pages.figure_style import AFTER, BEFORE, GREY
from adk_ros.mismatch.inference.result import IdentifiedEffect, MismatchResult
from adk_ros.mismatch.inference.segments import SpatialProfile
from adk_ros.mismatch.library.effect import PLACE
from adk_ros.mismatch.recording.sensor_log import CHANNELS, UNITS
from adk_ros.mismatch.report.comparison_labels import (
    model_labels,
    residual_labels,
    trend_labels,
)
from adk_ros.mismatch.report.location_figures import DPI
from adk_ros.mismatch.report.residual_trends import BINS, Trend
from adk_ros.mismatch.report.summary import pair_text
from adk_ros.mismatch.report.vocabulary import CHANNEL_TITLES, STATES, quantity, unit_text
from adk_ros.numerics.arrays import FloatArray

_LABEL_WIDTH = 80
"""Characters of an axis label that fit below a figure."""
_MIN_RATIO = 0.05
"""Lower end of the axis of residual over noise."""


def rms(residuals: FloatArray, settled: int) -> FloatArray:
    """Return the RMS of each channel (6,) of residuals (6, b) after settling."""
    return np.asarray(np.sqrt(np.mean(residuals[:, settled:] ** 2, axis=1)))


def profile_figure(result: MismatchResult, identified: IdentifiedEffect) -> SpatialProfile | None:
    """Return the unconstrained size of a local effect along the lap, if there is one."""
    if identified.kind != PLACE:
        return None
    return next((m for m in result.profiles if m.effect == identified.effect.name), None)


def trend_figure(
    result: MismatchResult, item: Trend, identified: IdentifiedEffect | None, path: Path
) -> None:
    """Draw the residual against the variable; for a local effect, its size along the lap too."""
    profile = None if identified is None else profile_figure(result, identified)
    figure, axes = plt.subplots(
        1 if profile is None else 2,
        1,
        sharex=True,
        squeeze=False,
        constrained_layout=True,
        figsize=(7.6, 3.6 if profile is None else 5.4),
        height_ratios=[1.0] if profile is None else [1.5, 1.0],
    )
    axis = axes[0, 0]
    without, with_effects = trend_labels(result)
    for values, sides, colour, marker, label in (
        (item.before, item.before_sides, BEFORE, "o", without),
        (item.after, item.after_sides, AFTER, "s", with_effects),
    ):
        axis.fill_between(item.at, sides[0], sides[1], color=colour, alpha=0.13, linewidth=0.0)
        axis.plot(
            item.at,
            values,
            color=colour,
            marker=marker,
            linewidth=1.2,
            markersize=5.0 if item.at.size <= BINS else 3.5,
            linestyle="-" if label == without else "--",
            markerfacecolor=colour if label == without else "white",
            label=label,
        )
    axis.axhline(0.0, color="black", linewidth=0.7)
    unit = unit_text(UNITS[CHANNELS.index(item.channel)])
    axis.set_ylabel(f"residual of {CHANNEL_TITLES[item.channel]} ({unit})", fontsize=9)
    axis.legend(fontsize=9)
    if profile is not None and identified is not None:
        _size(axes[1, 0], profile, identified, result.lap_m or float(profile.at.max()))
    for each in axes[:, 0]:
        each.grid(alpha=0.3)
        if identified is not None and identified.kind == PLACE and result.lap_m is not None:
            _shade(each, identified, result.lap_m)
    axes[-1, 0].set_xlabel(textwrap.fill(item.label, _LABEL_WIDTH))
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _size(axis: Axes, profile: SpatialProfile, identified: IdentifiedEffect, lap: float) -> None:
    """Draw the size of a local effect along the lap: unconstrained in each bin, and as fitted."""
    parameter = identified.effect.parameters[0]
    written = quantity(identified.effect.name, parameter.name, parameter.unit)

    def shown(values: FloatArray) -> list[float]:
        return [written.convert(float(value)) for value in values]

    axis.step(
        profile.at,
        shown(profile.size + parameter.neutral),
        where="mid",
        color=GREY,
        linewidth=1.0,
        label="unconstrained first estimate (other effects not yet removed)",
    )
    along = np.linspace(0.0, lap, 1000)
    active = np.zeros(along.shape, dtype=bool)
    for begin, end in identified.segments:
        active |= (along - begin) % lap <= end - begin
    value = identified.parameters[parameter.name].value
    axis.plot(
        along,
        shown(np.where(active, value, parameter.neutral)),
        color="black",
        linewidth=1.6,
        label="as fitted",
    )
    unit = f" ({written.unit})" if written.unit else ""
    axis.set_ylabel(f"{written.label}{unit}".replace(", ", ",\n"), fontsize=9)
    axis.legend(fontsize=8)


def _shade(axis: Axes, identified: IdentifiedEffect, lap: float) -> None:
    for begin, end in identified.segments:
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


def errors_figure(result: MismatchResult, path: Path) -> None:
    """Draw the errors of both models on held-out data, one panel per state."""
    figure, axes = plt.subplots(1, 3, figsize=(9.0, 2.4), constrained_layout=True)
    # Only the first panel that is evaluated has labels: all have the same bars.
    labels = [label.replace(" ", "\n", 1) for label in model_labels(result)]
    for axis, (name, (state, unit)) in zip(axes, STATES.items(), strict=True):
        values = (result.before[name], result.after[name])
        axis.set_xlabel(f"RMS error of {state} ({unit})")
        if not np.isfinite(values).all():
            axis.text(0.5, 0.5, "not evaluated", ha="center", va="center", fontsize=9)
            axis.set_xticks([])
            axis.set_yticks([])
            continue
        bars = axis.barh(
            [0, 1],
            values,
            color=(BEFORE, AFTER),
            edgecolor="black",
            hatch=("", "////"),
            height=0.65,
        )
        axis.bar_label(bars, pair_text(*values), padding=3, fontsize=9)
        axis.set_yticks([0, 1], labels)
        labels = ["", ""]
        axis.invert_yaxis()
        axis.set_xlim(0.0, 1.3 * max(*values, 1e-9))
        axis.locator_params(axis="x", nbins=4)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def unexplained_figure(
    result: MismatchResult, before: FloatArray, after: FloatArray, path: Path
) -> None:
    """Draw the residual over noise (6,) of each channel, without and with identified effects."""
    labels = residual_labels(result)
    figure, axis = plt.subplots(figsize=(7.6, 2.9), constrained_layout=True)
    rows = np.arange(6)
    first, second = np.maximum(before, _MIN_RATIO), np.maximum(after, _MIN_RATIO)
    axis.hlines(rows, np.minimum(first, second), np.maximum(first, second), color="0.6", zorder=1)
    axis.plot(first, rows, "o", color=BEFORE, markersize=8, label=labels[0])
    axis.plot(
        second, rows, "s", color=AFTER, markersize=8, markerfacecolor="white", label=labels[1]
    )
    axis.axvline(1.0, color="black", linewidth=1.0, linestyle=":", label="noise")
    axis.set_xscale("log")
    low, high = min(0.7, 0.8 * float(second.min())), max(3.0, 1.4 * float(first.max()))
    axis.set_xlim(low, high)
    marks = [x for x in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500) if low <= x <= high]
    axis.set_xticks(marks, [f"{x:g}" for x in marks])
    axis.minorticks_off()
    axis.set_yticks(rows, [CHANNEL_TITLES[name] for name in CHANNELS], fontsize=9)
    axis.invert_yaxis()
    axis.set_xlabel("RMS residual of 40 ms bins / noise")
    axis.grid(alpha=0.3, axis="x")
    axis.legend(fontsize=9)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
