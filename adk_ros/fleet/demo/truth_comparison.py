# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compare the result of a synthetic fleet with what was injected.

An effect is named if it is claimed at its level, or if such a claim has it among its ties. Of a
trend the shape may differ. A second claim of an effect that was injected once is false. A place is
found if a claimed cell of its effect lies on it. Sizes are compared where the effect itself is
claimed with the injected shape.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.fleet_result import AND, Claim, FleetResult, PlaceClaim
from adk_ros.fleet.inference.levels import TRENDS, Level, is_trend
from adk_ros.fleet.inference.place_evidence import CELL_M

_ON_PLACE_M = CELL_M * math.sqrt(0.5)
"""Distance from the centre of a cell to its corners, m."""


@dataclass(frozen=True)
class TruthComparison:
    """
    A line for each injected effect and each false claim, and counts.

    `named`: injected effects (places with them) that are claimed, `tied`: those of them that are
    among the ties of a claim only; `inside`: of `sized` compared sizes those whose 90 % interval
    holds the injected one.
    """

    lines: tuple[str, ...]
    injected: int
    named: int
    tied: int
    false: int
    sized: int
    inside: int

    @property
    def summary(self) -> str:
        """The counts as one line."""
        tied = f" ({self.tied} in a tie)" if self.tied else ""
        return (
            f"{self.named} of {self.injected} injected effects are named at the right level"
            f"{tied}; "
            f"{self.false or 'no'} false claim{'s' * (self.false != 1)}; "
            f"{self.inside} of {self.sized} sizes in their 90 % interval"
        )


def compare_with_truth(result: FleetResult, truth: Mapping[str, Any]) -> TruthComparison:
    """
    Compare the result of a fleet with the content of its `truth.json`.

    `truth["place"]` may be None: then every claimed place is false.
    """
    known = [_Injected(each) for each in truth["effects"]]
    claims = {each: each.claims_among(result.claims) for each in known}
    used = [claim for found in claims.values() for claim in found]
    left = [c for c in result.claims if c not in used]
    tied = {each: [c for c in left if each.is_tie_of(c)] for each in known if not claims[each]}
    false = [c for c in left if not any(c in found for found in tied.values())]
    lines, inside, sized = [], 0, 0
    for each in known:
        found = claims[each] or tied[each]
        sizes = "; ".join(_claim_text(c, "" if claims[each] else "tied with ") for c in found)
        word = "found " if found else "MISSED"
        lines.append(f"{word} {each.text}: {each.size:.4g}; {sizes or 'not claimed'}")
        for claim in claims[each]:
            if claim.kind == each.level.kind:
                sized += 1
                inside += claim.low <= each.size <= claim.high
    place = truth["place"]
    places = [p for p in result.places if place and _is_at(p, place)]
    if place:
        lines.append(f"{'found ' if places else 'MISSED'} {place['effect']} (at a place)")
    lines += [f"FALSE  {c.effect} ({c.level}): {c.size:.4g}" for c in false]
    others = [p for p in result.places if p not in places]
    lines += [f"FALSE  {p.effect} (at a place): {p.size:.4g}" for p in others]
    ties = sum(bool(found) for found in tied.values())
    named = sum(bool(found) for found in claims.values()) + ties + bool(places)
    return TruthComparison(
        tuple(lines),
        len(known) + bool(place),
        named,
        ties,
        len(false) + len(others),
        sized,
        inside,
    )


class _Injected:
    """An injected effect; `size`: its parameter's difference from neutral."""

    def __init__(self, known: Mapping[str, Any]) -> None:
        self.effect: str = known["effect"]
        self.level = Level(**known["level"])
        ((name, value),) = known["parameters"].items()
        self.size: float = value - column_of(f"{self.effect}.{name}").parameter.neutral
        self.text = f"{self.effect} ({self.level.text})"

    def claims_among(self, claims: Sequence[Claim]) -> list[Claim]:
        """Return the claim of this effect, of the injected shape before others; none or one."""
        found = [claim for claim in claims if self.is_claimed_by(claim)]
        found.sort(key=lambda claim: (claim.kind != self.level.kind, -claim.evidence))
        return found[:1]

    def is_claimed_by(self, claim: Claim) -> bool:
        level = self.level
        if claim.effect != self.effect or claim.car != level.car:
            return False
        if is_trend(level):
            return claim.kind in TRENDS
        return (claim.kind, claim.tag, claim.value) == (level.kind, level.tag, level.value)

    def is_tie_of(self, claim: Claim) -> bool:
        if not is_trend(self.level):
            return any(self.text in tie.split(AND) for tie in claim.ties)
        where = f" on in {self.level.car or 'all cars'})"
        return any(t.startswith(f"{self.effect} (") and t.endswith(where) for t in claim.ties)


def _claim_text(claim: Claim, prefix: str) -> str:
    name = f"{prefix}{claim.effect} ({claim.level}) " if prefix else ""
    return f"{name}{claim.parameter} {claim.size:+.4g} ({claim.low:+.4g} to {claim.high:+.4g})"


def _is_at(claim: PlaceClaim, place: Mapping[str, Any]) -> bool:
    """Whether a claimed cell of the effect lies on the stretch of road that has it."""
    return claim.effect == place["effect"] and any(
        math.dist(centre, at) <= _ON_PLACE_M for centre in claim.centres for at in place["path"]
    )
