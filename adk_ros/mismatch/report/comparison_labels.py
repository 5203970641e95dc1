# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Labels of what a page compares: the simulation, and the simulation with what was identified.

Residuals are those of the surrogate model with the identified effects, sensor faults included.
Open-loop predictions are those of the corrected vehicle model, which has no sensor faults.
"""

from __future__ import annotations

from adk_ros.mismatch.inference.result import NONE, MismatchResult

SIMULATION = "simulation"
_WITHIN_TOLERANCE = "within build tolerance"


def residual_labels(result: MismatchResult) -> tuple[str, str]:
    """Return the labels of the residuals: of the simulation, and with what was identified."""
    has_formula = result.unexplained is not None and bool(result.unexplained.terms)
    if result.effects:
        return SIMULATION, "with identified effects" + (" and formula" if has_formula else "")
    return SIMULATION, "with formula" if has_formula else _WITHIN_TOLERANCE


def trend_labels(result: MismatchResult) -> tuple[str, str]:
    """Return the labels of the residual trend of one effect: without it, and with all of them."""
    before, after = residual_labels(result)
    return ("without this effect" if result.series.without else before), after


def model_labels(result: MismatchResult) -> tuple[str, str]:
    """Return the labels of the open-loop predictions: of the simulation, and as corrected."""
    return SIMULATION, _WITHIN_TOLERANCE if result.verdict == NONE else "corrected vehicle model"
