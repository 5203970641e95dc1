# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keys of `mismatch.json` for the sections that open the page: signals, characteristics, asked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from adk_ros.mismatch.deployment.predicted_signals import AHEAD_S
from adk_ros.mismatch.inference.asked_effect import AskedEffect, AskedFit
from adk_ros.mismatch.inference.result import Interval, MismatchResult
from adk_ros.mismatch.inference.signal_fit import PredictedSignals
from adk_ros.mismatch.inference.steady_state import AIR_DENSITY, Characteristic, line_error
from adk_ros.mismatch.report.tie_rows import MAX_SHOWN
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


def _number(value: float | None) -> float | None:
    """Return six digits; null for what is not finite, or a limit that is never reached."""
    if value is None or not math.isfinite(value) or abs(value) >= MAX_SHOWN:
        return None
    return float(f"{value:.6g}")


def _signals(signals: PredictedSignals) -> dict[str, Any]:
    return {
        "data": signals.source,
        "ahead_s": AHEAD_S,
        "fit_percent": {
            name: dict(
                zip(("before", "after", "noise_limit"), (_number(x) for x in fit), strict=True)
            )
            for name, fit in signals.fits().items()
        },
    }


def _line(shown: Characteristic, entry: int, unit: float, name: str) -> dict[str, Any]:
    def interval(line: FloatArray, left_out: FloatArray) -> dict[str, float | None]:
        value = unit * float(line[entry])
        half = QUANTILE_90 * unit * float(line_error(left_out)[entry])
        ends = {"low": _number(value - half), "high": _number(value + half)}
        return {"value": _number(value), **ends}

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
            "loss": _number(found.loss),
            "distinguishes": found.distinguishes,
        },
    }


def _other(name: str, first: str, second: str) -> str:
    return first if second == name else second


def _fit(fit: AskedFit | None) -> dict[str, Any] | None:
    if fit is None:
        return None
    return {
        "parameters": _parameters(fit.parameters),
        "kind": fit.kind,
        "segments_m": [[round(a, 1), round(b, 1)] for a, b in fit.segments],
        "onset_s": _number(fit.onset_s),
        "gain": _number(fit.gain),
        "required": _number(fit.required),
        "share": _number(fit.share),
        "detectable": {name: _number(x) for name, x in fit.detectable.items()},
        "more_driving": _number(fit.more_driving),
    }


def _parameters(parameters: Mapping[str, Interval]) -> dict[str, Any]:
    return {
        name: {
            "value": _number(x.value),
            "low": _number(x.low),
            "high": _number(x.high),
            "unit": x.unit,
        }
        for name, x in parameters.items()
    }
