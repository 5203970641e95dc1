# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Labels of what a page compares: the simulation, and the simulation with what was identified.

Residuals are those of the surrogate model with the identified effects, sensor faults included.
Open-loop predictions are those of the corrected vehicle model, which has no sensor faults; where
no correction is exported, it is the simulation.
"""

from __future__ import annotations

from adk_ros.mismatch.inference.result import NONE, NOT_EXPORTED, MismatchResult

SIMULATION = "simulation"
_WITHIN_TOLERANCE = "within build tolerance"
_NOT_CORRECTED = "uncorrected simulation"


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
    if result.verdict == NONE:
        return SIMULATION, _NOT_CORRECTED
    return SIMULATION, "corrected vehicle model" if _is_exported(result) else _NOT_CORRECTED


def characteristic_labels(result: MismatchResult) -> tuple[str, str]:
    """Return the labels of understeer and resistance: of the simulation, and as fitted."""
    return model_labels(result) if _is_exported(result) else residual_labels(result)


def _is_exported(result: MismatchResult) -> bool:
    return result.held_out is None or result.held_out.export != NOT_EXPORTED
