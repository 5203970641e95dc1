# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""False alarms, power and coverage of the combination, on numerical fleets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from adk_ros.fleet.inference.assessment import Assessment
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, draw_fleet


@dataclass(frozen=True)
class Characteristics:
    """
    Counts over fleets.

    `with_false_alarm`: fleets with any claim that was not injected; `found` of `injected` terms at
    the right level; `covered` of `found` intervals contain the size.
    """

    fleets: int = 0
    with_false_alarm: int = 0
    injected: int = 0
    found: int = 0
    covered: int = 0

    def plus(
        self, plan: FleetPlan, claims: Sequence[Assessment], keys: Sequence[str]
    ) -> Characteristics:
        """Return the counts with one more fleet."""
        wanted = {(i.key, i.level): i.size for i in plan.injections}
        claimed = {(keys[c.candidate.effect], c.candidate.level): c for c in claims}
        hits = [(claimed[k], size) for k, size in wanted.items() if k in claimed]
        covered = sum(c.interval[0] <= size <= c.interval[1] for c, size in hits)
        return Characteristics(
            self.fleets + 1,
            self.with_false_alarm + bool(set(claimed) - set(wanted)),
            self.injected + len(wanted),
            self.found + len(hits),
            self.covered + covered,
        )


def characteristics(plan: FleetPlan, seeds: Sequence[int]) -> Characteristics:
    """Return the counts over the fleets of a plan with these seeds."""
    out = Characteristics()
    for seed in seeds:
        fleet = draw_fleet(seed, plan)
        selection = Selection(fleet)
        claims = selection.assessed(selection.select())
        out = out.plus(plan, claims, fleet.columns.effects)
    return out
