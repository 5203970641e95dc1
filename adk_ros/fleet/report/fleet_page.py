# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a fleet, and the comparison of two fleets."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from adk_ros.files.pages.page import embed, render_page
from adk_ros.files.pages.provenance import Provenance
from adk_ros.fleet.inference.corrected_models import MODELS
from adk_ros.fleet.inference.fleet_result import FleetResult, NotClaimed
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.fleet.report.fleet_figures import map_figure, matrix_figure, trend_figure
from adk_ros.fleet.report.fleet_rows import (
    claim_rows,
    not_claimed_rows,
    place_rows,
    summary_sentence,
)

PAGE, DATA = "fleet.html", "fleet.json"
_WORST = 20
"""Most recordings in the table of the worst. By choice."""


def write_fleet_page(
    result: FleetResult,
    out: Path,
    *,
    provenance: Provenance | None = None,
    links: Mapping[str, str] | None = None,
    models: Mapping[str, str] | None = None,
    failed: Sequence[tuple[str, str]] = (),
    unplaced: str = "",
) -> Path:
    """
    Write `fleet.html`, `fleet.json`, figures and corrected models into a folder.

    Corrected models of an earlier result that are not among `models` are removed.

    `links`: recording -> address of its report; `models`: file name -> text
    (`corrected_models`); `failed`: recordings without evidence, with the reason; `unplaced`:
    what `fleet_rows.unplaced_text` says.
    """
    figures: dict[str, Any] = {}
    if result.vehicles:
        matrix_figure(result, out / "vehicles.png")
        figures["matrix"] = embed(out / "vehicles.png", "Size of each claimed effect in each car")
    if result.visited:
        map_figure(result, out / "map.png")
        figures["map"] = embed(out / "map.png", "Map of all drives with the claimed places")
    trends = []
    keys = dict.fromkeys((p.effect, p.parameter) for p in result.trends)
    for i, key in enumerate(keys):
        points = [p for p in result.trends if (p.effect, p.parameter) == key]
        claims = [c for c in result.claims if (c.effect, c.parameter) == key]
        path = out / f"trend_{i}.png"
        trend_figure(points, claims[0].unit, {c.car for c in claims if c.car}, path)
        trends.append(embed(path, f"Size of {key[0]} by recording over time"))
    for path in out.glob(MODELS):
        # Of a claim that is no longer made.
        if path.name not in (models or {}):
            path.unlink()
    for name, text in (models or {}).items():
        (out / name).write_text(text, encoding="utf-8")
    (out / DATA).write_text(json.dumps(result.as_dict(), indent=1), encoding="utf-8")
    text = render_page(
        "adk_ros.fleet.report",
        "fleet.html.j2",
        provenance,
        sentence=summary_sentence(result),
        claims=claim_rows(result.claims),
        missing=claim_rows([c for c in result.claims if c.kind == SHARED]),
        doubtful=not_claimed_rows(doubtful(result)),
        places=place_rows(result.places),
        not_claimed=not_claimed_rows(result.not_claimed),
        matrix=figures.get("matrix"),
        map=figures.get("map"),
        trends=trends,
        worst=_worst_rows(result, links or {}),
        models=sorted(models or {}),
        failed=[list(pair) for pair in failed],
        unplaced=unplaced,
        outdated=[[r.name, r.note] for r in result.recordings if r.note],
        tests=result.tests,
        further_drives=result.further_drives,
        unsettled=result.unsettled,
        recordings=len(result.recordings),
        cars=len(result.cars),
    )
    path = out / PAGE
    path.write_text(text, encoding="utf-8")
    return path


def _worst_rows(result: FleetResult, links: Mapping[str, str]) -> list[list[Any]]:
    rows: list[list[Any]] = []
    for r in result.worst(_WORST):
        name: Any = r.name
        if r.name in links:
            name = Markup('<a href="{}">{}</a>').format(links[r.name], escape(r.name))
        tags = ", ".join(f"{k} {v}" for k, v in r.tags.items())
        rows.append(
            [name, r.car, f"{r.day:.1f}", tags, f"{r.loss_before:.3g}", f"{r.loss_ratio:.3g}"]
        )
    return rows


def doubtful(result: FleetResult) -> list[NotClaimed]:
    """Return candidates of all cars that are significant and yet not claimed."""
    text = Level(SHARED).text
    return [c for c in result.not_claimed if c.level == text and c.is_claimable]
