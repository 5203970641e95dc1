# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the comparisons of similar effects have said, over the passes of an analysis.

A selection sees the recordings as they are linearised, at the claims of the pass before. Where it
would claim again what left more of the loss when it was linearised at itself, that is a candidate
next to the better one only: a lag next to the delay for which it stood.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from adk_ros.fleet.inference.assessment import Assessment
from adk_ros.fleet.inference.competing_effects import (
    Sample,
    competing_keys,
    exchanged_for_competing,
    is_compared,
    parameter_of,
)
from adk_ros.fleet.inference.evidence import Row
from adk_ros.fleet.inference.fleet_candidates import Identity, identity
from adk_ros.fleet.inference.fleet_estimate import EvidenceAt, FleetEstimate
from adk_ros.fleet.inference.levels import CONDITION, Level

Contexts = dict[Identity, frozenset[Identity]]


class EffectComparisons:
    """
    Comparisons of the claims of successive estimates with similar effects.

    `beside`: what left more of the loss -> what it is a candidate next to.
    """

    def __init__(self) -> None:
        self.beside: dict[Identity, Identity] = {}
        self._examined: set[tuple[Identity, frozenset[Identity]]] = set()

    def sampled(
        self, estimate: FleetEstimate, rows: Mapping[str, Sequence[Row]]
    ) -> frozenset[str]:
        """Return the recordings, of those in `rows`, that the comparisons of the claims need."""
        kept = self._kept(_contexts(estimate))
        return frozenset(
            name
            for claim in estimate.claims
            if is_compared(estimate, claim, kept)
            for name in Sample.of(estimate, claim, rows).names
        )

    def _kept(self, contexts: Contexts) -> set[Identity]:
        return {known for known in contexts if (known, contexts[known]) in self._examined}

    def exchanged(
        self,
        estimate: FleetEstimate,
        rows: Mapping[str, Sequence[Row]],
        evidence_at: EvidenceAt,
        is_near: bool,
    ) -> FleetEstimate:
        """
        Return the estimate with claims exchanged for similar effects that leave less of the loss.

        `rows`: of each recording; those that are `sampled` are linearised at `estimate`.
        `is_near`: whether it is near the effects. Far from them much else is unexplained, so that
        nothing is settled; near them a claim is compared once, and again when the claims of
        similar effects are others.
        """
        contexts = _contexts(estimate)
        found, worse = exchanged_for_competing(estimate, rows, evidence_at, self._kept(contexts))
        if is_near:
            self._examined.update(contexts.items())
            for loser, winner in worse.items():
                self._settle(loser, winner, estimate.selection.levels)
        return found

    def _settle(self, loser: Identity, winner: Identity, levels: Sequence[Level]) -> None:
        """Keep that an effect is worse than another, in place of what was said of both before."""
        effect, level = loser
        self.beside.pop(winner, None)
        losers = {loser}
        if level.kind == CONDITION:
            # The same the other way round: less of it with the other values than in all cars.
            others = {x for x in levels if (x.kind, x.tag) == (CONDITION, level.tag)}
            losers |= {(effect, other) for other in others}
        losers |= {one for one, better in self.beside.items() if better == loser}
        self.beside |= dict.fromkeys(losers - {winner}, winner)


def _contexts(estimate: FleetEstimate) -> Contexts:
    """Return what each claim is about -> what the claims of similar effects are about."""
    return {
        identity(claim.candidate): _similar_claims(estimate, claim) for claim in estimate.claims
    }


def _similar_claims(estimate: FleetEstimate, claim: Assessment) -> frozenset[Identity]:
    """Return what the claims of similar effects are about, at any level."""
    key = parameter_of(estimate, claim)
    similar = set(competing_keys(key))
    similar |= {other for one in similar for other in competing_keys(one)}
    return frozenset(
        identity(one.candidate)
        for one in estimate.claims
        if parameter_of(estimate, one) in similar | {key}
    )
