# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keys of `mismatch.json` for the sections that open the page: signals, characteristics, asked."""

from __future__ import annotations

from typing import Any

from adk_ros.mismatch.deployment.predicted_signals import AHEAD_S
from adk_ros.mismatch.inference.asked_effect import AskedEffect, AskedFit
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.inference.signal_fit import PredictedSignals
from adk_ros.mismatch.inference.steady_state import AIR_DENSITY, Characteristic, line_error
from adk_ros.mismatch.report.json_values import json_number, json_parameters
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY, QUANTILE_90


def opening_as_dict(result: MismatchResult) -> dict[str, Any]:
    """Return the keys `signals`, `steady_state` and `asked`, those that there are."""
    keys: dict[str, Any] = {}
    if result.signals is not None:
        keys["signals"] = _signals(result.signals)
    shown = result.steady_state
    if shown is not None:
        steady: dict[str, Any] = {}
        if shown.understeer is not None:
            # rad per m/s², as ISO 8855 defines the understeer gradient.
            steady["understeer_gradient"] = _line(shown.understeer, 0, 1.0, "rad s^2/m")
            steady["steering_at_zero"] = _line(shown.understeer, 1, 1.0, "rad")
        if shown.resistance is not None:
            area = 2.0 * shown.mass / AIR_DENSITY
            steady["drag_area"] = _line(shown.resistance, 0, area, "m^2")
            steady["rolling_resistance"] = _line(shown.resistance, 1, 1.0 / GRAVITY, "-")
        if steady:
            keys["steady_state"] = steady
    if result.asked:
        keys["asked"] = [_asked(each) for each in result.asked]
    return keys


def _signals(signals: PredictedSignals) -> dict[str, Any]:
    return {
        "data": signals.source,
        "ahead_s": AHEAD_S,
        "fit_percent": {
            name: dict(
                zip(("before", "after", "noise_limit"), (json_number(x) for x in fit), strict=True)
            )
            for name, fit in signals.fits().items()
        },
    }


def _line(shown: Characteristic, entry: int, unit: float, name: str) -> dict[str, Any]:
    def interval(line: FloatArray, left_out: FloatArray) -> dict[str, float | None]:
        value = unit * float(line[entry])
        half = QUANTILE_90 * unit * float(line_error(left_out)[entry])
        ends = {"low": json_number(value - half), "high": json_number(value + half)}
        return {"value": json_number(value), **ends}

    measured, simulation = shown.measured, shown.simulation
    return {
        "measured": interval(measured.line, measured.left_out),
        "simulation": interval(simulation.line, simulation.left_out),
        "corrected": interval(shown.corrected.line, shown.corrected.left_out),
        "difference": interval(
            measured.line - simulation.line, measured.left_out - simulation.left_out
        ),
        "unit": name,
    }


def _asked(asked: AskedEffect) -> dict[str, Any]:
    found = asked.distinguishing
    return {
        "name": asked.name,
        "claimed": asked.claimed,
        "reason": asked.reason,
        "next_to": list(asked.next_to),
        "alone": _fit(asked.alone),
        "added": _fit(asked.added),
        "manoeuvre": None
        if found is None
        else {
            "text": found.manoeuvre,
            "against": None
            if found.other == found.of
            else _other(asked.name, found.of, found.other),
            "loss": json_number(found.loss),
            "distinguishes": found.distinguishes,
        },
    }


def _other(name: str, first: str, second: str) -> str:
    return first if second == name else second


def _fit(fit: AskedFit | None) -> dict[str, Any] | None:
    if fit is None:
        return None
    return {
        "parameters": json_parameters(fit.parameters),
        "kind": fit.kind,
        "segments_m": [[round(a, 1), round(b, 1)] for a, b in fit.segments],
        "onset_s": json_number(fit.onset_s),
        "gain": json_number(fit.gain),
        "required": json_number(fit.required),
        "share": json_number(fit.share),
        "detectable": {name: json_number(x) for name, x in fit.detectable.items()},
        "more_driving": json_number(fit.more_driving),
    }
