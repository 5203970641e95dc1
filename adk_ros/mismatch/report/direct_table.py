# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Direct comparisons of simulation and recording: JSON, table rows, and a sentence."""

from __future__ import annotations

import math
from typing import Any

from adk_ros.mismatch.inference.direct_evidence import uncovered
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.recording.direct_comparison import DirectComparison, Estimate
from adk_ros.mismatch.report.vocabulary import listed, title, unit_text
from adk_ros.numerics.constants import QUANTILE_90

HEADER = ["quantity", "simulation", "recording", "difference (90 % interval)", "decision"]
_EFFECTS_NAMED = 3
"""Most effects that a sentence names as possible causes: the most direct ones."""


def uncovered_comparisons(result: MismatchResult) -> list[DirectComparison]:
    """Return the significant differences that the result does not cover."""
    claimed = {one.effect.name for one in result.effects}
    claimed |= {name for one in result.effects for name in one.alternatives}
    equations = () if result.unexplained is None else result.unexplained.equations
    return uncovered(result.direct, claimed, equations)


def direct_as_dicts(result: MismatchResult) -> list[dict[str, Any]]:
    """Return the key `direct` of `mismatch.json`."""
    silent = {each.name for each in uncovered_comparisons(result)}
    return [
        {
            "name": each.name,
            "quantity": each.quantity,
            "unit": each.unit,
            "simulation": _interval(each.simulation),
            "recording": _interval(each.recording),
            "difference": _interval(each.difference),
            "tolerance": float(f"{each.tolerance:.4g}"),
            "differs": each.differs,
            "covered": each.name not in silent,
            "effects": list(each.effects),
            "assumption": each.assumption,
        }
        for each in result.direct
    ]


def direct_rows(result: MismatchResult) -> list[list[str]]:
    """Return quantity, value of simulation and recording, difference, decision."""
    silent = {each.name for each in uncovered_comparisons(result)}
    rows = []
    for each in result.direct:
        decision = "within build tolerance and error"
        if each.differs:
            decision = "differs; not explained by the result"
            if each.name not in silent:
                decision = "differs, as the result says"
        rows.append(
            [
                f"{each.quantity} ({unit_text(each.unit)})".removesuffix(" ()"),
                f"{each.simulation.value:.3g}",
                f"{each.recording.value:.3g}",
                _difference_text(each),
                decision,
            ]
        )
    return rows


def uncovered_text(result: MismatchResult) -> str:
    """Return a sentence on the differences that the result does not cover; empty without any."""
    silent = uncovered_comparisons(result)
    if not silent:
        return ""
    parts = []
    for each in silent:
        causes = listed([title(name) for name in each.effects[:_EFFECTS_NAMED]], "or")
        parts.append(
            f"{each.quantity} differs by {_difference_text(each)}, as {causes} would cause"
        )
    return (
        "Compared directly, without a surrogate model, the recording also differs from the "
        f"simulation beyond build tolerance: {'; '.join(parts)}."
    )


def _difference_text(each: DirectComparison) -> str:
    """Return "-6.5 % (-7.5 to -5.6)", or the difference in its unit."""
    found, factor, unit = each.difference, 1.0, unit_text(each.unit)
    if each.is_relative and each.simulation.value != 0.0:
        factor, unit = 100.0 / abs(each.simulation.value), "%"
    half = QUANTILE_90 * found.deviation * factor
    decimals = 3
    if half > 0.0:
        decimals = max(-math.floor(math.log10(half)), 0)
    value = found.value * factor
    text = f"{value:+.{decimals}f} {unit}".rstrip()
    return f"{text} ({value - half:+.{decimals}f} to {value + half:+.{decimals}f})"


def _interval(estimate: Estimate) -> dict[str, float]:
    low, high = estimate.interval
    return {
        name: float(f"{value:.6g}")
        for name, value in (("value", estimate.value), ("low", low), ("high", high))
    }
