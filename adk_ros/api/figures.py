# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Figures of the Python interface.

Each function returns a `matplotlib.figure.Figure` that no backend owns: a notebook shows it, and
`figure.savefig(path)` writes it. Colours are distinguishable for colour-blind readers (Okabe and
Ito); line styles differ as well.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES, STATE_UNITS

_COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
_STYLES = ("-", "-", "--", "-.", ":", (0, (3, 1, 1, 1, 1, 1)))


def _label(channel: str, unit: str) -> str:
    return f"{channel.replace('_', ' ') if channel == 'yaw_rate' else channel} ({unit})"


def state_figure(time_s: FloatArray, curves: Mapping[str, FloatArray], title: str) -> Figure:
    """
    Draw states against time, one panel per channel.

    :param time_s: (n,), s. :param curves: label -> states (n, 3) in SI units; NaN leaves a gap.
    """
    figure = Figure(figsize=(9.0, 6.5), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for channel, axis in enumerate(axes):
        for number, (label, states) in enumerate(curves.items()):
            axis.plot(
                time_s,
                states[:, channel],
                color=_COLOURS[number % len(_COLOURS)],
                linestyle=_STYLES[number % len(_STYLES)],
                linewidth=1.6 if number == 0 else 1.1,
                label=label,
            )
        axis.set_ylabel(_label(STATE_NAMES[channel], STATE_UNITS[channel]))
        axis.grid(alpha=0.3)
    axes[0].legend(loc="best", fontsize=8)
    axes[-1].set_xlabel("time (s)")
    figure.suptitle(title)
    return figure


def score_figure(scores: pd.DataFrame, title: str) -> Figure:
    """Draw RMSE against the horizon, one panel per channel; `scores` as `tables.score_frame`."""
    figure = Figure(figsize=(11.0, 3.8), layout="constrained")
    axes = figure.subplots(1, 3)
    names = [name for name in scores.columns if not name.startswith("ratio")]
    for channel, axis in enumerate(axes):
        rows = scores.loc[STATE_NAMES[channel]] if len(scores) else scores
        for number, name in enumerate(names if len(rows) else ()):
            axis.loglog(
                rows.index,
                rows[name],
                color=_COLOURS[(number + 1) % len(_COLOURS)],
                linestyle=_STYLES[(number + 1) % len(_STYLES)],
                marker="os^vDx"[number % 6],
                markersize=4,
                label=name,
            )
        axis.set_xlabel("horizon (s)")
        axis.set_ylabel(f"RMSE, {_label(STATE_NAMES[channel], STATE_UNITS[channel])}")
        axis.grid(alpha=0.3, which="both")
    if len(scores):
        axes[0].legend(fontsize=7)
    figure.suptitle(title)
    return figure


def residual_figure(
    time_s: FloatArray,
    before: FloatArray,
    after: FloatArray,
    channels: tuple[str, ...],
    title: str,
) -> Figure:
    """
    Draw residuals in multiples of the noise against time, one panel per channel.

    :param time_s: (n,), s. :param before, after: (k, n), of the simulation and of the corrected
        model, divided by the noise of a sample. :param channels: the k names.
    """
    figure = Figure(figsize=(9.0, 1.5 * len(channels)), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(channels), 1, sharex=True))
    for row, axis in enumerate(axes):
        axis.plot(time_s, before[row], color=_COLOURS[2], linewidth=0.8, label="simulation")
        axis.plot(time_s, after[row], color=_COLOURS[1], linewidth=0.8, label="corrected model")
        axis.set_ylabel(channels[row], fontsize=8)
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8, ncols=2)
    axes[-1].set_xlabel("time (s)")
    figure.suptitle(title)
    return figure


def improvement_figure(errors: pd.DataFrame, title: str) -> Figure:
    """Draw `simulation` and `corrected` errors as bars; one panel per channel in the index."""
    figure = Figure(figsize=(8.0, 3.0), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(errors)))
    for axis, (channel, row) in zip(axes, errors.iterrows(), strict=True):
        axis.bar(
            ["simulation", "corrected"],
            [row["simulation"], row["corrected"]],
            color=[_COLOURS[2], _COLOURS[1]],
        )
        axis.set_title(_label(str(channel), str(row["unit"])), fontsize=9)
        axis.grid(alpha=0.3, axis="y")
    figure.suptitle(title)
    return figure
