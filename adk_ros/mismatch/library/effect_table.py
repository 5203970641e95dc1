# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The catalogue of effects as Markdown table rows, for generated documentation."""

from __future__ import annotations

from collections.abc import Sequence

from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.categories import (
    AMBIGUOUS,
    CALIBRATION,
    PARAMETERS,
    PHYSICS,
    category_of,
)
from adk_ros.mismatch.library.effect import Effect, EffectParameter

_HEADER = (
    "effect",
    "parameters",
    "category",
    "equation",
    "active",
    "excited by",
    "confusable with",
    "separated by",
)
_SYMBOLS = {"^2": "²", "^3": "³", "kg m²": "kg·m²", "N m": "N·m", "rad s²/m": "rad·s²/m"}


def effect_table() -> str:
    """
    Return all effects of the catalogue as a Markdown table, one row per effect.

    Columns: name, parameters with units, category, equation, possible activations, excitation,
    confusable effects, and the manoeuvre that separates the effect from those.
    """
    rows = [_HEADER, tuple("---" for _ in _HEADER), *(_row(effect) for effect in EFFECTS.values())]
    return "\n".join(_markdown_row(row) for row in rows)


def _markdown_row(cells: Sequence[str]) -> str:
    """Return one row; a vertical bar within a cell is escaped."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _row(effect: Effect) -> tuple[str, ...]:
    return (
        f"`{effect.name}`",
        ", ".join(_parameter_text(parameter) for parameter in effect.parameters),
        _category_text(effect.name),
        f"`{effect.equation}`",
        ", ".join(effect.activations),
        effect.excitation,
        ", ".join(f"`{name}`" for name in effect.confusables) or "none",
        effect.manoeuvre,
    )


def _category_text(name: str) -> str:
    """Return category and, for a calibration, which parameters correct it."""
    if category_of(name) == PHYSICS:
        return PHYSICS
    text = f"{CALIBRATION} or {PHYSICS}" if name in AMBIGUOUS else CALIBRATION
    return f"{text}: {', '.join(f'`{each}`' for each in PARAMETERS[name]) or 'no parameter'}"


def _parameter_text(parameter: EffectParameter) -> str:
    """Return name and unit, such as `cda` (m²); a dimensionless parameter has its name only."""
    unit = parameter.unit
    for plain, typeset in _SYMBOLS.items():
        unit = unit.replace(plain, typeset)
    return f"`{parameter.name}`" if unit == "-" else f"`{parameter.name}` ({unit})"
