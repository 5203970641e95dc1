# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result of one check, and the rule that turns an estimate into a verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

from adk_ros.calibration.criteria import MATERIAL, SIGNIFICANCE
from adk_ros.calibration.regression import Estimate


class Verdict(str, Enum):
    """What the data say about a quantity."""

    OK = "ok"
    FINDING = "finding"
    NOT_DECIDABLE = "not decidable"


@dataclass(frozen=True)
class Finding:
    """
    The result of one check.

    `name` identifies it in JSON, `text` says it in a sentence. `value` with its 90 % interval
    `low`, `high` in `unit`, None if nothing was estimated; `nominal`: the value without a fault;
    `standard_errors`: distance from it. `evidence`: which regression of which signals;
    `seconds`: driving that it used. `parameters`: proposed values by parameter name; where it is
    empty and the verdict is a finding, `remedy` says what to do instead.
    """

    name: str
    verdict: Verdict
    text: str
    value: float | None = None
    low: float | None = None
    high: float | None = None
    unit: str = ""
    nominal: float | None = None
    standard_errors: float | None = None
    evidence: str = ""
    seconds: float | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    remedy: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the finding for JSON."""
        return {
            "name": self.name,
            "verdict": self.verdict.value,
            "text": self.text,
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "unit": self.unit,
            "nominal": self.nominal,
            "standard_errors": self.standard_errors,
            "evidence": self.evidence,
            "seconds": self.seconds,
            "parameters": dict(self.parameters),
            "remedy": self.remedy,
        }


NO_PARAMETER = "no parameter for this yet: correct the recording"


def ok(name: str, text: str, evidence: str = "") -> Finding:
    """Return the result of a check that found nothing."""
    return Finding(name, Verdict.OK, text, evidence=evidence)


def not_decidable(name: str, reason: str, evidence: str = "") -> Finding:
    """Return the result of a check that the data cannot decide; `reason` follows "because"."""
    return Finding(
        name, Verdict.NOT_DECIDABLE, f"not decidable, because {reason}", evidence=evidence
    )


def undecided(finding: Finding, reason: str) -> Finding:
    """Return a finding that another cause explains as well, with its numbers and that reason."""
    text = f"not decidable, because {reason}"
    return replace(finding, verdict=Verdict.NOT_DECIDABLE, text=text, parameters={}, remedy="")


def found(
    name: str,
    text: str,
    evidence: str,
    parameters: Mapping[str, Any] | None = None,
    remedy: str = NO_PARAMETER,
) -> Finding:
    """Return a finding that is not a number, such as a flipped sign."""
    return Finding(
        name,
        Verdict.FINDING,
        text,
        evidence=evidence,
        parameters=parameters or {},
        remedy="" if parameters else remedy,
    )


def shown(value: float, size: float) -> str:
    """Return a number with one decimal more than the smallest material size has."""
    decimals = max(1 - math.floor(math.log10(size)), 0)
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def judged(
    name: str,
    estimate: Estimate,
    nominal: float,
    text: str,
    evidence: str,
    *,
    kind: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    remedy: str = NO_PARAMETER,
    scale: float = 1.0,
) -> Finding:
    """
    Return the verdict on an estimate by the rule of `criteria`.

    :param kind: key of `criteria.MATERIAL`, default: `name`.
    :param text: what a finding says, before its number.
    :param scale: factor on the material size, such as a nominal length for a relative size.
    """
    material = MATERIAL[kind or name]
    size = material.size * scale
    distance = abs(estimate.value - nominal)
    half_width = 0.5 * (estimate.high - estimate.low)
    errors = distance / estimate.standard_error if estimate.standard_error > 0.0 else None
    is_significant = errors is None or errors >= SIGNIFICANCE
    value, low, high = (shown(x, size) for x in (estimate.value, estimate.low, estimate.high))
    number = f"{value} ({low} to {high})"
    unit = "" if material.unit == "1" else f" {material.unit}"
    if distance >= size and is_significant and distance > 0.0:
        verdict, said = Verdict.FINDING, f"{text}: {number}{unit}, nominal {nominal:.3g}{unit}"
    elif half_width <= size:
        verdict, said = Verdict.OK, f"{number}{unit}, nominal {nominal:.3g}{unit}"
    else:
        verdict = Verdict.NOT_DECIDABLE
        said = (
            f"not decidable, because the interval {number}{unit} is wider than "
            f"±{size:.2g}{unit}, the smallest material size"
        )
    is_finding = verdict is Verdict.FINDING
    return Finding(
        name,
        verdict,
        said,
        estimate.value,
        estimate.low,
        estimate.high,
        material.unit,
        nominal,
        errors,
        evidence,
        estimate.seconds,
        (parameters or {}) if is_finding else {},
        "" if parameters or not is_finding else remedy,
    )
