# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Categories of the effects and what to set for calibrations, for the page and as JSON."""

from __future__ import annotations

from typing import Any

from adk_ros.mismatch.inference.result import IdentifiedEffect, MismatchResult
from adk_ros.mismatch.library.categories import CALIBRATION, category_of, is_ambiguous
from adk_ros.mismatch.report.calibration_parameters import Parameters, parameters_by_effect
from adk_ros.mismatch.report.calibration_text import (
    of_category,
    remedy_text,
    settings_texts,
    unconditional_parameters,
)
from adk_ros.mismatch.report.vocabulary import title

CALIBRATION_HEADER = ["calibration", "what to do"]


def calibrations_as_dict(result: MismatchResult) -> dict[str, Any]:
    """Return what to set in any case, and the text with all conditions, for `mismatch.json`."""
    if not of_category(result.effects, CALIBRATION):
        return {}
    text = " ".join(settings_texts(result))
    return {"calibration": {"parameters": unconditional_parameters(result), "text": text}}


def category_as_dict(
    identified: IdentifiedEffect, by_effect: dict[str, Parameters]
) -> dict[str, Any]:
    """Return category, whether it may be the other one, and what to set, for `mismatch.json`."""
    name = identified.effect.name
    entry: dict[str, Any] = {
        "category": category_of(name),
        "category_ambiguous": is_ambiguous(name, identified.alternatives),
    }
    if name in by_effect:
        entry["calibration"] = {
            "parameters": by_effect[name],
            "text": remedy_text(identified, by_effect[name]),
        }
    return entry


def calibration_rows(result: MismatchResult) -> list[list[str]]:
    """Return calibration and what to set on which condition, as rows of the page's table."""
    by_effect = parameters_by_effect(result.effects, result.sensors)
    return [
        [title(each.effect.name), remedy_text(each, by_effect[each.effect.name]) or "nothing"]
        for each in of_category(result.effects, CALIBRATION)
    ]
