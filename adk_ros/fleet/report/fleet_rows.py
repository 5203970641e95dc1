# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the tables of a fleet's page."""

from __future__ import annotations

from collections.abc import Sequence

from adk_ros.fleet.inference.fleet_result import Claim, FleetResult, NotClaimed, PlaceClaim
from adk_ros.fleet.inference.levels import CAR, CONDITION, SHARED
from adk_ros.mismatch.report.vocabulary import listed, title, unit_text, with_titles

CLAIM_HEADER = [
    "effect",
    "where",
    "size",
    "90 % interval",
    "between cars",
    "indistinguishable from",
]


def claim_rows(claims: Sequence[Claim]) -> list[list[str]]:
    """Return effect, level, size, interval, deviation between cars, and ties."""
    return [
        [
            f"{title(c.effect)}, {c.parameter}",
            c.level,
            f"{c.size:.3g} {unit_text(c.unit)}".strip(),
            f"{c.low:.3g} to {c.high:.3g}",
            f"{c.between_cars:.1g}",
            with_titles("; ".join(c.ties)) if c.ties else "-",
        ]
        for c in claims
    ]


def place_rows(places: Sequence[PlaceClaim]) -> list[list[str]]:
    """Return effect, place, size, interval, number of recordings, and ties."""
    rows = []
    for p in places:
        x = sum(c[0] for c in p.centres) / len(p.centres)
        y = sum(c[1] for c in p.centres) / len(p.centres)
        rows.append(
            [
                f"{title(p.effect)}, {p.parameter}",
                f"x {x:.0f} m, y {y:.0f} m ({len(p.cells)} cells)",
                f"{p.size:.3g} {unit_text(p.unit)}".strip(),
                f"{p.low:.3g} to {p.high:.3g}",
                str(p.recordings),
                listed([title(t) for t in p.ties], "or") or "-",
            ]
        )
    return rows


def not_claimed_rows(candidates: Sequence[NotClaimed]) -> list[list[str]]:
    """Return effect, level, size, interval, reason."""
    return [
        [
            f"{title(c.effect)}, {c.parameter}",
            c.level,
            f"{c.size:.3g} {unit_text(c.unit)}".strip(),
            f"{c.low:.3g} to {c.high:.3g}",
            c.reason,
        ]
        for c in candidates
    ]


def summary_sentence(result: FleetResult) -> str:
    """Return what is found, in a sentence or two."""
    of = f"In {len(result.recordings)} recordings of {len(result.cars)} cars"
    shared = [title(c.effect) for c in result.claims if c.kind == SHARED]
    if not result.claims and not result.places:
        return f"{of}, no effect of the catalogue is significant at any level."
    parts = []
    if shared:
        parts.append(f"the simulation lacks {listed(list(dict.fromkeys(shared)))}")
    cars = {c.car for c in result.claims if c.car}
    if cars:
        parts.append(
            f"{listed(sorted(cars))} differ{'s' if len(cars) == 1 else ''} from the others"
        )
    conditions = {f"{c.tag} {c.value}" for c in result.claims if c.kind == CONDITION}
    if conditions:
        parts.append(f"{listed(sorted(conditions))} changes the behaviour")
    trends = {c.effect for c in result.claims if c.kind not in {SHARED, CAR, CONDITION}}
    if trends:
        parts.append(f"{listed(sorted(title(t) for t in trends))} changes over time")
    if result.places:
        names = sorted({title(p.effect) for p in result.places})
        parts.append(
            f"{len(result.places)} place{'s' * (len(result.places) > 1)} "
            f"differ{'s' * (len(result.places) == 1)} ({listed(names)})"
        )
    return f"{of}, {'; '.join(parts)}."
