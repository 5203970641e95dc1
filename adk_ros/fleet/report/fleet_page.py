# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a fleet, and the comparison of two fleets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from markupsafe import Markup, escape

from adk_ros.files.pages.page import embed, render_page
from adk_ros.files.whole_file import whole_file
from adk_ros.fleet.inference.corrected_models import MODELS
from adk_ros.fleet.inference.fleet_result import FleetResult, NotClaimed
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.fleet.report.file_names import DATA, PAGE
from adk_ros.fleet.report.fleet_figures import map_figure, matrix_figure, trend_figure
from adk_ros.fleet.report.fleet_rows import (
    claim_rows,
    not_claimed_rows,
    place_rows,
    summary_sentence,
    unplaced_text,
)
from adk_ros.fleet.report.result_file import PageContext, read_result, write_result

_WORST = 20
"""Recordings in the table of the worst, if no more have a report. By choice."""


def write_fleet_page(
    result: FleetResult,
    out: Path,
    context: PageContext | None = None,
    models: Mapping[str, str] | None = None,
) -> Path:
    """
    Write `fleet.html`, `fleet.json`, figures and corrected models into a folder.

    Corrected models of an earlier result that are not among `models` are removed.

    `models`: file name -> text (`corrected_models`).
    """
    context, models = context or PageContext(), models or {}
    for path in out.glob(MODELS):
        # Of a claim that is no longer made.
        if path.name not in models:
            path.unlink()
    for name, text in models.items():
        (out / name).write_text(text, encoding="utf-8")
    write_result(result, context, out / DATA)
    return _write_page(result, out, context, sorted(models))


def rewrite_fleet_page(out: Path) -> Path:
    """
    Write `fleet.html` and its figures again from `fleet.json`, which stays as it is.

    Reports and corrected models are linked that are still there.

    :raises DataError: `fleet.json` is damaged, or of another version of adk_ros.
    """
    result, context = read_result(out / DATA)
    reports = {
        name: address
        for name, address in context.reports.items()
        if (out / unquote(address)).is_file()
    }
    models = sorted(path.name for path in out.glob(MODELS))
    return _write_page(result, out, replace(context, reports=reports), models)


def _write_page(
    result: FleetResult, out: Path, context: PageContext, models: Sequence[str]
) -> Path:
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
    text = render_page(
        "adk_ros.fleet.report",
        "fleet.html.j2",
        context.provenance,
        sentence=summary_sentence(result),
        claims=claim_rows(result.claims),
        missing=claim_rows([c for c in result.claims if c.kind == SHARED]),
        doubtful=not_claimed_rows(doubtful(result)),
        places=place_rows(result.places),
        not_claimed=not_claimed_rows(result.not_claimed),
        matrix=figures.get("matrix"),
        map=figures.get("map"),
        trends=trends,
        worst=_worst_rows(result, context),
        models=models,
        failed=[list(pair) for pair in context.failed],
        unplaced=unplaced_text(context.unplaced),
        outdated=[[r.name, r.note] for r in result.recordings if r.note],
        tests=result.tests,
        further_drives=result.further_drives,
        unsettled=result.unsettled,
        recordings=len(result.recordings),
        cars=len(result.cars),
    )
    path = out / PAGE
    with whole_file(path) as file:
        file.write(text.encode("utf-8"))
    return path


def _worst_rows(result: FleetResult, context: PageContext) -> list[list[Any]]:
    """Return the worst recordings, each with its report, what makes it, or why there is none."""
    rows: list[list[Any]] = []
    for rank, r in enumerate(result.worst(len(result.recordings)), 1):
        # Below them, those with a report of an earlier ranking.
        if rank > _WORST and r.name not in context.reports:
            continue
        if r.name in context.reports:
            report = Markup('<a href="{}">report</a>').format(context.reports[r.name])
        elif r.name in context.failed_reports:
            report = escape(f"failed: {context.failed_reports[r.name]} (--retry-failed)")
        else:
            report = Markup("<code>--reports {}</code>").format(rank)
        tags = ", ".join(f"{k} {v}" for k, v in r.tags.items())
        losses = [f"{r.loss_before:.3g}", f"{r.loss_ratio:.3g}"]
        rows.append([r.name, r.car, f"{r.day:.1f}", tags, *losses, report])
    return rows


def doubtful(result: FleetResult) -> list[NotClaimed]:
    """Return candidates of all cars that are significant and yet not claimed."""
    text = Level(SHARED).text
    return [c for c in result.not_claimed if c.level == text and c.is_claimable]
