# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of effects that a recording does not distinguish from an identified one."""

from __future__ import annotations

import math

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.result import IdentifiedEffect
from adk_ros.mismatch.report.vocabulary import quantity, title

NO_LIMIT = "no limit"
"""Size of an inverse parameter at neutral: a limit that is never reached."""
MAX_SHOWN = 1e11
"""SI. A larger value is that of an inverse parameter at neutral."""


def value_text(effect: str, parameter: str, unit: str, value: float) -> str:
    """Return "-4 m/s" or "+17 %": a size with two digits, without its label."""
    written = quantity(effect, parameter, unit)
    if not math.isfinite(value) or abs(value) > MAX_SHOWN:
        return NO_LIMIT
    shown = float(f"{written.convert(value):.2g}")
    return f"{shown:{'+' if written.is_change else ''}g} {written.unit}".rstrip()


def tie_rows(identified: IdentifiedEffect) -> list[list[str]]:
    """Return one row per parameter of each alternative, as `report_tables.effect_rows` does."""
    rows = []
    fitted = {x.name: x.fitted for x in identified.competitors}
    for name in identified.alternatives:
        confidence = probability_text(identified.posterior.get(name, math.nan))
        for i, cells in enumerate(_parameter_cells(name, fitted.get(name))):
            first = [f"or {title(name)}" if i == 0 else "", *cells]
            rows.append([*first, "not distinguishable" if i == 0 else "", confidence])
            confidence = ""
    return rows


def _parameter_cells(name: str, fitted: ActiveEffect | None) -> list[list[str]]:
    """Return label, size, ratio or angle of each parameter; one empty row if it was not fitted."""
    if fitted is None:
        return [["", "", ""]]
    cells = []
    for parameter, theta in zip(fitted.effect.parameters, fitted.theta, strict=True):
        written, value = quantity(name, parameter.name, parameter.unit), parameter.value(theta)
        size = value_text(name, parameter.name, parameter.unit, value)
        angle = "" if size == NO_LIMIT else written.ratio_or_angle(value)
        cells.append([written.label, size, angle])
    return cells


def probability_text(probability: float) -> str:
    """Return a probability with two digits; nothing where it is unknown."""
    return f"{probability:.2f}" if math.isfinite(probability) else ""
