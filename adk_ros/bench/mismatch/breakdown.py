# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the acceptance criteria average over: ties, intervals by simulator, raised errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.bench.mismatch.acceptance import FULL, OWN_FAMILY, WEAK, WEAKEST
from adk_ros.bench.mismatch.case_score import UNKNOWN, CaseResult
from adk_ros.bench.mismatch.reliability import CONFIDENT
from adk_ros.bench.vehicles.multibody import MULTI_BODY

TIE = "|"
"""Between an effect and its alternatives in the text of a claim (`CaseResult.reported`)."""


def breakdown(scores: Sequence[CaseResult]) -> list[str]:
    """Return one sentence per figure that the criteria do not show."""
    return [
        _all_clears(scores),
        _confident(scores),
        *_intervals(scores),
        _largest_errors(scores),
        _raised(scores),
        *_weaker(scores),
        _alone(scores),
        _unlisted(scores),
    ]


def _all_clears(scores: Sequence[CaseResult]) -> str:
    # A dropout of a sensor may be nothing to report.
    some = [s for s in scores if s.kind != "none" and (s.kind != UNKNOWN or s.correctable)]
    strong = [s for s in some if s.strength > WEAKEST]
    missed = [s.case for s in strong if s.reported == "none"]
    weak = sum(s.reported == "none" for s in some) - len(missed)
    return (
        f"Nothing reported where something is injected: {len(missed)} of {len(strong)}"
        f"{_listed(missed)}; at strength {WEAKEST:g} {weak} of {len(some) - len(strong)}."
    )


def _confident(scores: Sequence[CaseResult]) -> str:
    claims = [(s, c) for s in scores for c in s.claims if c.confidence >= CONFIDENT]
    ties = [(s, c) for s, c in claims if TIE in c.effect]
    first = sum(c.effect.partition(TIE)[0] in s.label.split(" + ") for s, c in ties)
    wrong = [f"{c.effect} in {s.case}" for s, c in claims if not c.right]
    return (
        f"Claims with a confidence of at least {CONFIDENT:g}: {len(claims)}, wrong {len(wrong)}"
        f"{_listed(wrong)}; ties {len(ties)}, right {sum(c.right for _, c in ties)}, with the "
        f"injected effect first {first}."
    )


def _intervals(scores: Sequence[CaseResult]) -> list[str]:
    out = []
    for name, some in (
        ("multi-body model", [s for s in scores if s.plant == MULTI_BODY]),
        ("other simulators", [s for s in scores if s.plant != MULTI_BODY]),
    ):
        held = [x for s in some for x in s.covered.values()]
        errors = [x for s in some for x in s.errors.values()]
        median = f", median error {100.0 * float(np.median(errors)):.2f} %" if errors else ""
        out.append(f"90 % intervals, {name}: {sum(held)} of {len(held)} hold{median}.")
    return out


def _largest_errors(scores: Sequence[CaseResult]) -> str:
    errors = [x for s in scores for x in s.errors.values()]
    if not errors:
        return "Parameter errors: no figure."
    high, most = 100.0 * np.quantile(errors, 0.9), 100.0 * max(errors)
    return f"Parameter errors: 90th percentile {high:.1f} %, largest {most:.0f} %."


def _raised(scores: Sequence[CaseResult]) -> str:
    # Without a correction, both errors are the same.
    corrected = [s.raised for s in scores if np.isfinite(s.raised) and s.raised != 0.0]
    raised = [x for x in corrected if x > 0.0]
    most = f", by at most {100.0 * max(raised):.1f} %" if raised else ""
    return (
        f"Corrections: {len(corrected)} in {len(scores)} cases; with an error that rises at the "
        f"first stated horizon {len(raised)}{most}."
    )


def _weaker(scores: Sequence[CaseResult]) -> list[str]:
    singles = [s for s in scores if s.kind == "single" and s.plant != MULTI_BODY]
    out = []
    for strength in (WEAK, WEAKEST):
        every = [s.right for s in singles if s.strength == strength]
        other = [s.right for s in singles if s.strength == strength and s.plant not in OWN_FAMILY]
        out.append(
            f"Single effects at strength {strength:g}: {sum(every):.1f} of {len(every)} right, in "
            f"simulators of another family {sum(other):.1f} of {len(other)}."
        )
    return out


def _alone(scores: Sequence[CaseResult]) -> str:
    right = [
        s
        for s in scores
        if s.kind == "single" and s.plant != MULTI_BODY and s.strength == FULL and s.right == 1.0
    ]
    tied = sum(TIE in s.reported for s in right)
    return (
        f"Right single effects at strength {FULL:g}: {len(right)}, {len(right) - tied} named "
        f"alone and {tied} in ties."
    )


def _unlisted(scores: Sequence[CaseResult]) -> str:
    physics = [s.right for s in scores if s.kind == UNKNOWN and s.correctable]
    return f"Unlisted effects without those of sensors: {sum(physics):g} of {len(physics)} right."


def _listed(items: Sequence[str]) -> str:
    return f" ({'; '.join(items)})" if items else ""
