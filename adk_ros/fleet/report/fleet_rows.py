# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the tables of a fleet's page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.fleet.inference.fleet_result import Claim, FleetResult, NotClaimed, PlaceClaim
from adk_ros.fleet.inference.levels import CAR, CONDITION, SHARED
from adk_ros.fleet.report.claim_text import claim_text, level_text
from adk_ros.mismatch.report.vocabulary import listed, title, unit_text, with_titles


def claim_rows(claims: Sequence[Claim]) -> list[list[str]]:
    """Return effect with its size, level, interval, deviation between cars, and ties."""
    rows = []
    for c in claims:
        text = claim_text(c)
        ties = with_titles("; ".join(c.ties)) if c.ties else "-"
        deviation = f"{c.between_cars:.1g} {unit_text(c.unit)}".strip()
        rows.append([text.phrase, level_text(c), text.interval, deviation, ties])
    return rows


def place_rows(places: Sequence[PlaceClaim]) -> list[list[str]]:
    """Return effect with its size, place, interval, who passed on how many days, and ties."""
    rows = []
    for p in places:
        x = sum(c[0] for c in p.centres) / len(p.centres)
        y = sum(c[1] for c in p.centres) / len(p.centres)
        text = claim_text(p)
        where = f"x {x:.0f} m, y {y:.0f} m ({len(p.cells)} cell{'s' * (len(p.cells) > 1)})"
        ties = listed([title(t) for t in p.ties], "or") or "-"
        days = "on 1 day only" if p.days == 1 else f"on {p.days} days"
        cars = f"{p.cars} car{'s' * (p.cars > 1)}"
        passing = f"{p.recordings} recordings, by {cars}, {days}"
        rows.append([text.phrase, where, text.interval, passing, ties])
    return rows


def not_claimed_rows(candidates: Sequence[NotClaimed]) -> list[list[str]]:
    """Return effect with its size, level, interval, reason."""
    rows = []
    for c in candidates:
        text = claim_text(c)
        rows.append([text.phrase, c.level, text.interval, c.reason])
    return rows


def summary_sentence(result: FleetResult) -> str:
    """Return what is found, by level, in a sentence."""
    of = f"In {len(result.recordings)} recordings of {len(result.cars)} cars"
    if not result.claims and not result.places:
        is_doubtful = any(c.is_claimable for c in result.not_claimed)
        what = "claimed" if is_doubtful else "significant"
        nothing = f"{of}, no effect of the catalogue is {what} at any level."
        return f"{nothing} {_what_is_left(result)}"
    by_level: dict[str, list[str]] = {}
    for claim in sorted(result.claims, key=lambda c: _LEVELS.index(_group(c))):
        by_level.setdefault(level_text(claim), []).append(claim_text(claim).phrase)
    parts = [f"{listed(phrases)} ({level})" for level, phrases in by_level.items()]
    if result.places:
        phrases = list(dict.fromkeys(claim_text(p).phrase for p in result.places))
        number = len(result.places)
        parts.append(f"{listed(phrases)} (at {number} place{'s' * (number > 1)})")
    return f"{of}, relative to the simulation: {'; '.join(parts)}."


def unplaced_text(number: int) -> str:
    """Return why `number` recordings take no part in the search for places, "" for none."""
    if not number:
        return ""
    begin, count = ("begins", "counts") if number == 1 else ("begin", "count")
    return (
        f"{number} recording{'s' * (number > 1)} {begin} at x = y = 0 and {count} for no place: "
        "positions from the start of each drive are not those of a map"
    )


def _what_is_left(result: FleetResult) -> str:
    """Return how much is unexplained without a claim, and whether for want of cars."""
    loss = float(np.median([r.loss_ratio for r in result.recordings]))
    text = f"The squared residuals are {loss:.2g} times those of a perfect model (median)."
    if len(result.cars) < _FEW_CARS:
        text += (
            " So few cars do not tell an effect of all from one of each: name their cars in "
            "fleet.csv, or analyse them together by 'adk mismatch' with several --recording."
        )
    return text


_FEW_CARS = 4
"""Cars below which the deviation between them hides what they share: with three, an effect has two
degrees of freedom, and significance among thousands of tests needs a hundred deviations."""
_LEVELS = (SHARED, CONDITION, CAR, "")
"""Order of the levels in the sentence; "" for trends."""


def _group(claim: Claim) -> str:
    return claim.kind if claim.kind in _LEVELS else ""
