# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of two results of one fleet, before and after an update of the simulation."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from adk_ros.errors import UsageError
from adk_ros.files.pages.page import render_page
from adk_ros.files.pages.provenance import Provenance
from adk_ros.fleet.inference.fleet_result import SCHEMA
from adk_ros.mismatch.report.vocabulary import title, unit_text

PAGE = "comparison.html"
FIXED, NEW, CHANGED, SAME = "no longer claimed", "new", "changed", "unchanged"


def compared_claims(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[list[str]]:
    """
    Return effect, level, size before, size after, and what became of it, for each claim.

    Arguments are contents of `fleet.json`. A trend is the same whatever its change point. Sizes
    are changed if their 90 % intervals do not overlap.
    """
    old, new = _by_key(before), _by_key(after)
    rows = []
    for key in dict.fromkeys([*old, *new]):
        a, b = old.get(key), new.get(key)
        if b is None:
            status = FIXED
        elif a is None:
            status = NEW
        else:
            apart = a["low"] > b["high"] or b["low"] > a["high"]
            status = CHANGED if apart else SAME
        one = b or a
        assert one is not None
        rows.append(
            [
                f"{title(one['effect'])}, {one['parameter']}",
                one["level"],
                _size(a),
                _size(b),
                status,
            ]
        )
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
        if content.get("schema") != SCHEMA:
            raise UsageError(f"{name} is no fleet.json of this version: run the report again")
    losses = compared_losses(before, after)
    text = render_page(
        "adk_ros.fleet.report",
        "comparison.html.j2",
        provenance,
        names=names,
        claims=compared_claims(before, after),
        improved=losses[:10],
        worsened=[row for row in reversed(losses[-10:]) if float(row[2]) > float(row[1])],
        common=len(losses),
    )
    path = out / PAGE
    path.write_text(text, encoding="utf-8")
    return path


def _by_key(content: Mapping[str, Any]) -> dict[tuple[str, ...], Mapping[str, Any]]:
    return {
        (c["effect"], c["parameter"], c["kind"], c["car"], c["tag"], c["value"]): c
        for c in content["claims"]
    }


def _size(claim: Mapping[str, Any] | None) -> str:
    if claim is None:
        return "-"
    unit = unit_text(claim["unit"])
    return f"{claim['size']:.3g} {unit}".strip() + f" ({claim['low']:.3g} to {claim['high']:.3g})"
