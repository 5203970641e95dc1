# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of two results of one fleet, before and after an update of the simulation."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from adk_ros.errors import UsageError
from adk_ros.files.pages.page import render_page
from adk_ros.files.pages.provenance import Provenance
from adk_ros.fleet.inference.fleet_result import AND, SCHEMA, place_text
from adk_ros.fleet.inference.levels import TRENDS
from adk_ros.fleet.inference.place_evidence import CELL_M
from adk_ros.mismatch.report.vocabulary import title, unit_text

PAGE = "comparison.html"
FIXED, NEW, CHANGED, SAME = "no longer claimed", "new", "changed", "unchanged"
LISTED = "no longer claimed, but still a candidate"
TIED = "tied: the other one is named"

COMPARABLE = frozenset({1, SCHEMA})
"""Schemas of results whose claims, places and recordings have all that is compared."""

Claim = Mapping[str, Any]
"""A claim or a place of `fleet.json`."""


def compared_claims(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[list[str]]:
    """
    Return effect, level, size before, size after, and what became of it, for each claim.

    Arguments are contents of `fleet.json`. A trend is the same whatever its change point, and a
    place if the cells touch. Sizes are changed if their 90 % intervals do not overlap. Of two
    effects that a fleet does not distinguish, each result may name another one.
    """
    pairs = _paired(before["claims"], after["claims"], _is_same_claim)
    pairs += _paired(before["places"], after["places"], _is_same_place)
    rows = []
    for a, b in pairs:
        one = b or a
        assert one is not None
        name = f"{title(one['effect'])}, {one['parameter']}"
        if b is None:
            status = LISTED if _is_listed(one, after["not_claimed"]) else FIXED
        elif a is None:
            status = NEW
        elif a["effect"] != b["effect"]:
            name, status = f"{title(a['effect'])}, now {title(b['effect'])}", TIED
        else:
            apart = a["low"] > b["high"] or b["low"] > a["high"]
            status = CHANGED if apart else SAME
        rows.append([name, _level(one), _size(a), _size(b), status])
    return rows


def compared_losses(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[list[str]]:
    """Return recording, loss ratio without effects before and after, for common recordings."""
    old = {r["name"]: r["loss_before"] for r in before["recordings"]}
    new = {r["name"]: r["loss_before"] for r in after["recordings"]}
    common = sorted(set(old) & set(new), key=lambda name: new[name] - old[name])
    return [[name, f"{old[name]:.3g}", f"{new[name]:.3g}"] for name in common]


def write_comparison(
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    out: Path,
    *,
    names: tuple[str, str] = ("before", "after"),
    provenance: Provenance | None = None,
) -> Path:
    """
    Write the page that compares two results (contents of `fleet.json`).

    :raises UsageError: a content is no result of a fleet.
    """
    for name, content in zip(names, (before, after), strict=True):
        if content.get("schema") not in COMPARABLE:
            raise UsageError(
                f"{name} is no fleet.json of this version: run 'adk fleet mismatch' again"
            )
    losses = compared_losses(before, after)
    text = render_page(
        "adk_ros.fleet.report",
        "comparison.html.j2",
        provenance,
        names=names,
        claims=compared_claims(before, after),
        improved=[row for row in losses[:10] if float(row[2]) < float(row[1])],
        worsened=[row for row in reversed(losses[-10:]) if float(row[2]) > float(row[1])],
        common=len(losses),
    )
    path = out / PAGE
    path.write_text(text, encoding="utf-8")
    return path


def _paired(
    before: Sequence[Claim], after: Sequence[Claim], is_same: Callable[[Claim, Claim], bool]
) -> list[tuple[Claim | None, Claim | None]]:
    """
    Return each claim before with that after, and those without the other one.

    The same effect first, since another one that it is tied with may be claimed next to it; of
    several changes of one effect over time, those with the nearest change points.
    """
    candidates = sorted(
        (not _has_effect_of(a, b), _days_apart(a, b), i, j)
        for i, a in enumerate(before)
        for j, b in enumerate(after)
        if is_same(a, b)
    )
    partner: dict[int, int] = {}
    for *_, i, j in candidates:
        if i not in partner and j not in partner.values():
            partner[i] = j
    pairs: list[tuple[Claim | None, Claim | None]] = [
        (a, after[partner[i]] if i in partner else None) for i, a in enumerate(before)
    ]
    return pairs + [(None, b) for j, b in enumerate(after) if j not in partner.values()]


def _days_apart(a: Claim, b: Claim) -> float:
    """Return the days between the change points of two claims, 0 where neither has one."""
    days = [one.get("onset_day") for one in (a, b)]
    if days[0] is None or days[1] is None:
        return 0.0 if days[0] is days[1] else math.inf
    return abs(float(days[0]) - float(days[1]))


def _has_effect_of(a: Claim, b: Claim) -> bool:
    return (a["effect"], a["parameter"]) == (b["effect"], b["parameter"])


def _is_same_claim(a: Claim, b: Claim) -> bool:
    kinds = ["trend" if one["kind"] in TRENDS else one["kind"] for one in (a, b)]
    if kinds[0] != kinds[1] or any(a[key] != b[key] for key in ("car", "tag", "value")):
        return False
    return _has_effect_of(a, b) or _is_tied(a, b) or _is_tied(b, a)


def _is_tied(a: Claim, b: Claim) -> bool:
    """Whether `b` is among the ties of `a`, "effect (level)", whatever its change point."""
    named = _without_change_point(f"{b['effect']} ({b['level']})")
    return any(
        _without_change_point(each) == named for tie in a["ties"] for each in tie.split(AND)
    )


def _without_change_point(text: str) -> str:
    return re.sub(r"(growing )?from day \S+ on ", "", text)


def _is_same_place(a: Claim, b: Claim) -> bool:
    near = any(
        max(abs(x - u), abs(y - v)) <= CELL_M for x, y in a["centres"] for u, v in b["centres"]
    )
    tied = b["effect"] in a["ties"] or a["effect"] in b["ties"]
    return near and (_has_effect_of(a, b) or tied)


def _is_listed(claim: Claim, candidates: Sequence[Mapping[str, Any]]) -> bool:
    """Whether a claim is among the candidates that are significant and yet not claimed."""
    return any(
        c["is_claimable"]
        and _has_effect_of(c, claim)
        and _without_change_point(c["level"]) == _without_change_point(_level(claim))
        for c in candidates
    )


def _level(claim: Claim) -> str:
    if "level" in claim:
        return str(claim["level"])
    return place_text(claim["centres"][0])


def _size(claim: Claim | None) -> str:
    if claim is None:
        return "-"
    unit = unit_text(claim["unit"])
    return f"{claim['size']:.3g} {unit}".strip() + f" ({claim['low']:.3g} to {claim['high']:.3g})"
