# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The sections that open the page: signals over time, understeer and resistance, questions."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from adk_ros.files.pages.page import Figure, embed
from adk_ros.mismatch.deployment.predicted_signals import AHEAD_S, AVERAGED_S, STRIDE_S
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.inference.signal_fit import PredictedSignals
from adk_ros.mismatch.report.asked_text import HEADER as ASKED_HEADER
from adk_ros.mismatch.report.asked_text import answer_of
from adk_ros.mismatch.report.comparison_labels import characteristic_labels, model_labels
from adk_ros.mismatch.report.signal_figure import (
    SHOWN_S,
    fit_rows,
    shown_until,
    signals_figure,
)
from adk_ros.mismatch.report.steady_state_figures import HEADER as STEADY_STATE_HEADER
from adk_ros.mismatch.report.steady_state_figures import (
    resistance_figure,
    resistance_rows,
    understeer_figure,
    understeer_rows,
)
from adk_ros.mismatch.report.tolerance_bands import STEERING_RATIO

SIGNALS, UNDERSTEER, RESISTANCE = "signals.png", "understeer.png", "resistance.png"
OPENING_FIGURES = (SIGNALS, UNDERSTEER, RESISTANCE)


def opening_values(result: MismatchResult, out: Path) -> dict[str, Any]:
    """Draw the figures into the folder `out`; return the values of the template's sections."""
    return {
        "signals": _signals(result, out),
        "steady_state": _steady_state(result, out),
        "steady_state_header": STEADY_STATE_HEADER,
        "steering_ratio": STEERING_RATIO,
        "asked": [answer_of(each) for each in result.asked],
        "asked_header": ASKED_HEADER,
    }


def _signals(result: MismatchResult, out: Path) -> dict[str, Any] | None:
    signals = result.signals
    if signals is None or all(row[1] == "not evaluated" for row in fit_rows(signals)):
        return None
    labels = model_labels(result)
    signals_figure(signals, labels, out / SIGNALS)
    return {
        "figure": embed(
            out / SIGNALS,
            f"Measured signals over time, and their open-loop predictions {AHEAD_S:g} s ahead by "
            f"{labels[0]} and {labels[1]}, each with its residual",
        ),
        "rows": fit_rows(signals),
        "header": [f"fit of predictions {AHEAD_S:g} s ahead", *labels, "limit by sensor noise"],
        "source": signals.source,
        "shown": _shown(signals),
        "stride": f"{STRIDE_S:g}",
        "averaged": f"{1e3 * AVERAGED_S:.0f}",
    }


def _shown(signals: PredictedSignals) -> str:
    """Return which part of the predicted data the figure shows: "the first 40 s (0 to 40 s)"."""
    begin, end = float(signals.time_s[0]), shown_until(signals)
    part = "all" if end == float(signals.time_s[-1]) else f"the first {SHOWN_S:g} s"
    return f"{part} ({begin:.0f} to {end:.0f} s)"


def _steady_state(result: MismatchResult, out: Path) -> list[dict[str, Any]]:
    """Return heading, figure, seconds and rows of each characteristic that there is."""
    shown, parts = result.steady_state, []
    if shown is None:
        return []
    labels = characteristic_labels(result)
    for name, characteristic, draw, rows, file in (
        ("understeer", shown.understeer, understeer_figure, understeer_rows, UNDERSTEER),
        (
            "resistance",
            shown.resistance,
            resistance_figure,
            partial(resistance_rows, mass=shown.mass),
            RESISTANCE,
        ),
    ):
        if characteristic is None:
            continue
        draw(characteristic, labels, out / file)
        parts.append(
            {
                "name": name,
                "figure": _figure(out / file, name, labels),
                "seconds": f"{characteristic.seconds:.0f}",
                "rows": rows(characteristic),
            }
        )
    return parts


def _figure(path: Path, name: str, labels: tuple[str, str]) -> Figure:
    against = {"understeer": "lateral acceleration", "resistance": "speed"}[name]
    return embed(
        path,
        f"{name.capitalize()} against {against}: measured points, and the curves of {labels[0]} "
        f"and {labels[1]} with tolerance bands",
    )
