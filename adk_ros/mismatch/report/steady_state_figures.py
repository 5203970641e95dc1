# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Understeer and resistance with tolerance bands: figures, and rows of their tables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from adk_ros.files.pages.figure_style import AFTER, BEFORE, BLACK
from adk_ros.mismatch.inference.steady_state import (
    AIR_DENSITY,
    LINEAR_RANGE,
    Characteristic,
    CrossPlot,
    line_error,
)
from adk_ros.mismatch.report.location_figures import DPI
from adk_ros.mismatch.report.tolerance_bands import (
    inside,
    resistance_half_width,
    understeer_half_width,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY, QUANTILE_90

HEADER = [
    "quantity",
    "measured",
    "simulation",
    "measured less simulation",
    "measured less corrected",
]
Bands = Callable[[Characteristic, CrossPlot], FloatArray]


def understeer_figure(shown: Characteristic, labels: tuple[str, str], path: Path) -> None:
    """Draw the steering beyond Ackermann's against lateral acceleration, one panel per model."""
    figure, axes = _panels(shown, labels, understeer_half_width, float(np.degrees(1.0)))
    axes[0].set_ylabel("steering less Ackermann angle (°)")
    for axis in axes:
        axis.set_xlabel("lateral acceleration (m/s²), + left")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def resistance_figure(shown: Characteristic, labels: tuple[str, str], path: Path) -> None:
    """Draw the resistance over mass against speed, one panel per model."""
    figure, axes = _panels(shown, labels, resistance_half_width, 1.0)
    axes[0].set_ylabel("resistance over mass (m/s²)")
    for axis in axes:
        axis.set_xlabel("speed (m/s)")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _panels(
    shown: Characteristic, labels: tuple[str, str], bands: Bands, unit: float
) -> tuple[Figure, list[Axes]]:
    figure, axes = plt.subplots(1, 2, sharey=True, figsize=(9.0, 3.9), constrained_layout=True)
    measured = shown.measured
    for axis, model, label, colour, line, error in zip(
        axes,
        (shown.simulation, shown.corrected),
        labels,
        (BEFORE, AFTER),
        ("--", "-"),
        shown.errors,
        strict=True,
    ):
        half = bands(shown, model)
        axis.fill_between(
            model.x,
            unit * (model.y - half),
            unit * (model.y + half),
            color=colour,
            alpha=0.15,
            linewidth=0.0,
            label="tolerance band",
        )
        axis.plot(model.x, unit * model.y, color=colour, linestyle=line, label=label)
        axis.errorbar(
            measured.x,
            unit * measured.y,
            2.0 * unit * error,
            color=BLACK,
            fmt="o",
            markersize=4.0,
            linewidth=1.0,
            capsize=2.0,
            label="measured",
        )
        within = inside(measured, model, half, error)
        axis.set_title(
            f"{label}: measured points inside: {int(within.sum())} of {within.size}", fontsize=10
        )
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    return figure, list(axes)


def understeer_rows(shown: Characteristic) -> list[list[str]]:
    """Return understeer gradient, and steering at zero lateral acceleration."""
    degrees = float(np.degrees(1.0))
    return [
        [
            f"understeer gradient (°/g), up to {LINEAR_RANGE:g} m/s²",
            *_cells(shown, 0, degrees * GRAVITY),
        ],
        ["steering at zero lateral acceleration (°), + left", *_cells(shown, 1, degrees)],
    ]


def resistance_rows(shown: Characteristic, mass: float) -> list[list[str]]:
    """Return the drag area and the rolling resistance that the resistance's line implies."""
    return [
        ["drag area C_dA (m²)", *_cells(shown, 0, 2.0 * mass / AIR_DENSITY)],
        ["rolling resistance coefficient", *_cells(shown, 1, 1.0 / GRAVITY)],
    ]


def _cells(shown: Characteristic, entry: int, unit: float) -> list[str]:
    """Return one entry of each line, and of differences, with half its 90 % interval."""
    measured, simulation, corrected = shown.measured, shown.simulation, shown.corrected
    cells = [_cell(plot.line, plot.left_out, entry, unit) for plot in (measured, simulation)]
    for model in (simulation, corrected):
        line, left_out = measured.line - model.line, measured.left_out - model.left_out
        cells.append(_cell(line, left_out, entry, unit, "+"))
    return cells


def _cell(line: FloatArray, left_out: FloatArray, entry: int, unit: float, sign: str = "") -> str:
    value, half = unit * line[entry], QUANTILE_90 * unit * line_error(left_out)[entry]
    digits = int(np.clip(1 - np.floor(np.log10(max(half, 1e-6))), 0, 6))
    rounded = round(float(value), digits) + 0.0
    return f"{rounded:{sign}.{digits}f}\u00a0±\u00a0{half:.{digits}f}"
