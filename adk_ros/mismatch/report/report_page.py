# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The person's answer as a page that stands by itself, its figures as PNG beside it."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from adk_ros.mismatch.inference.likelihood import TOLERANCE_BOUND
from adk_ros.mismatch.inference.result import NONE, MismatchResult
from adk_ros.mismatch.inference.unmodelled import EQUATION_TEXTS as EQUATION_WORDS
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.features import FEATURES
from adk_ros.mismatch.report.evidence_figures import (
    errors_figure,
    rms,
    trend_figure,
    unexplained_figure,
)
from adk_ros.mismatch.report.location_figures import map_figure, timeline_figure
from adk_ros.mismatch.report.report_tables import (
    competitor_rows,
    effect_rows,
    error_rows,
    group_rows,
    loss_rows,
    surrogate_rows,
    unexplained_rows,
)
from adk_ros.mismatch.report.residual_trends import (
    SETTLING_BINS,
    Trend,
    effect_residual_trend,
    feature_residual_trend,
)
from adk_ros.mismatch.report.summary import sentence, underfit_channels, unexplained_text
from adk_ros.mismatch.report.vocabulary import CHANNELS as CHANNEL_WORDS
from adk_ros.mismatch.report.vocabulary import listed, title

PAGE = "report.html"
_MOST_PIECES = 8

FIGURES = (
    "map.png",
    "timeline.png",
    "errors.png",
    "remains.png",
    *(f"evidence_{name}.png" for name in EFFECTS),
    *(f"remainder_{i}.png" for i in range(1, _MOST_PIECES + 1)),
)
"""All figures that a report may have: those of an earlier one are not about this one."""


class Figure(NamedTuple):
    """A figure on the page: its file's name, its words, its bytes in base64."""

    name: str
    alt: str
    picture: str


def write_page(findings: MismatchResult, out: Path) -> Path:
    """Write `report.html` and its figures into the folder `out`; return the page."""
    series = findings.series
    before, after = rms(series.before, SETTLING_BINS), rms(series.after, SETTLING_BINS)
    where = [
        _figure(
            out,
            "map.png",
            "Map of the track, dark where simulation and recording differ",
            partial(map_figure, findings),
        ),
        _figure(
            out,
            "timeline.png",
            "Residuals by channel along time, before and after, and when each effect acts",
            partial(timeline_figure, findings),
        ),
    ]
    errors = _figure(
        out,
        "errors.png",
        f"Errors {findings.horizon_s:g} s ahead on held-out data, before and after",
        partial(errors_figure, findings),
    )
    remains = _figure(
        out,
        "remains.png",
        "Residual over noise by channel, before and after",
        partial(unexplained_figure, before / series.noise, after / series.noise),
    )
    environment = Environment(
        loader=PackageLoader("adk_ros.mismatch.report"),
        autoescape=True,
        undefined=StrictUndefined,
    )
    rest = findings.unexplained
    pieces = () if rest is None else rest.terms
    page = environment.get_template("report.html.j2").render(
        findings=findings,
        sentence=sentence(findings),
        missed=underfit_channels(findings) if findings.verdict == NONE else "",
        effects=effect_rows(findings),
        tolerance=100.0 * TOLERANCE_BOUND,
        where=where,
        evidence=_evidence(findings, out),
        errors=errors,
        remains=remains,
        rivals=[
            (title(found.effect.name), competitor_rows(found), found.gain, found.alternatives)
            for found in findings.effects
        ],
        losses=loss_rows(findings),
        error_rows=error_rows(findings),
        remains_rows=unexplained_rows(before, after, series.noise),
        unexplained=None if rest is None else unexplained_text(rest),
        groups=group_rows(findings),
        stand_in=surrogate_rows(findings),
        not_judged=listed([title(name) for name in findings.not_judged]),
        drivers=listed([FEATURES[piece.feature].description for piece in pieces])
        or "nothing known",
        needs=[(title(found.effect.name), found.effect.manoeuvre) for found in findings.effects],
    )
    path = out / PAGE
    path.write_text(re.sub(r"\n{3,}", "\n\n", page), encoding="utf-8")
    return path


def _figure(out: Path, name: str, alt: str, draw: Callable[[Path], None]) -> Figure:
    path = out / name
    draw(path)
    return Figure(name, alt, base64.b64encode(path.read_bytes()).decode())


def _evidence(findings: MismatchResult, out: Path) -> list[tuple[str, str, Figure]]:
    """Draw a figure an effect and one a feature of the remainder: (title, words, figure)."""
    parts = []
    for found in findings.effects:
        item = effect_residual_trend(findings.series, found)
        parts.append(
            (
                title(found.effect.name),
                f"{found.effect.equation}. {_said(item)}",
                _figure(
                    out,
                    f"evidence_{found.effect.name}.png",
                    _alt(item),
                    partial(trend_figure, findings, item, found),
                ),
            )
        )
    pieces = findings.unexplained.terms if findings.unexplained is not None else ()
    for i, piece in enumerate(pieces[:_MOST_PIECES], 1):
        item = feature_residual_trend(findings.series, piece)
        parts.append(
            (
                f"unexplained: {EQUATION_WORDS[piece.equation]}",
                _said(item),
                _figure(
                    out,
                    f"remainder_{i}.png",
                    _alt(item),
                    partial(trend_figure, findings, item, None),
                ),
            )
        )
    return parts


def _alt(item: Trend) -> str:
    return f"Residual of {CHANNEL_WORDS[item.channel]} against {item.label}, before and after"


def _said(item: Trend) -> str:
    """Return what the figure shows, in numbers."""
    largest = abs(item.before).max() / item.noise
    left = abs(item.after).max() / item.noise
    return (
        f"The residual of {CHANNEL_WORDS[item.channel]} against {item.label}: its mean goes up to "
        f"{largest:.2g} times the noise of a 40 ms bin before, and to {left:.2g} times after."
    )
