# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mismatch report as a self-contained HTML page, with its figures as PNG files next to it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from adk_ros.calibration.scope import Possible
from adk_ros.files.pages.page import Figure, embed, render_page
from adk_ros.files.pages.provenance import Provenance
from adk_ros.mismatch.inference.feature_effect import EQUATION_TEXTS
from adk_ros.mismatch.inference.result import (
    FULL,
    HALF_TOLERANCES,
    NONE,
    WITHOUT_TOLERANCES,
    MismatchResult,
)
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.categories import CALIBRATION, PHYSICS
from adk_ros.mismatch.library.criteria import (
    INEXACT_EQUATION_SHARE,
    MAX_EXPLAINED_RATIO,
    SENSOR_OFFSET_PRIORS,
    TOLERANCE_BOUND,
)
from adk_ros.mismatch.library.features import feature
from adk_ros.mismatch.library.parametric_features import is_transferable
from adk_ros.mismatch.report.agreement_table import agreement_parts
from adk_ros.mismatch.report.calibration_table import CALIBRATION_HEADER, calibration_rows
from adk_ros.mismatch.report.calibration_text import calibration_title, of_category
from adk_ros.mismatch.report.comparison_labels import (
    model_labels,
    residual_labels,
    trend_labels,
)
from adk_ros.mismatch.report.direct_table import HEADER as DIRECT_HEADER
from adk_ros.mismatch.report.direct_table import direct_rows
from adk_ros.mismatch.report.downweighted_table import downweighted_parts
from adk_ros.mismatch.report.evidence_figures import (
    errors_figure,
    rms,
    trend_figure,
    unexplained_figure,
)
from adk_ros.mismatch.report.location_figures import map_figure, timeline_figure
from adk_ros.mismatch.report.opening_sections import OPENING_FIGURES, opening_values
from adk_ros.mismatch.report.report_tables import (
    candidate_rows,
    competitor_rows,
    effect_rows,
    error_rows,
    group_rows,
    horizon_rows,
    judged_model,
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
from adk_ros.mismatch.report.summary import (
    has_only_sensor_faults,
    sentence,
    underfit_channels,
    unexplained_text,
    verdict_text,
)
from adk_ros.mismatch.report.vocabulary import CHANNEL_TITLES, listed, title, unit_text
from adk_ros.numerics.constants import GRAVITY

PAGE = "report.html"
_MAX_TERM_FIGURES = 8
_WITH_FORMULA = {FULL, HALF_TOLERANCES, WITHOUT_TOLERANCES}
"""Corrections that contain the formula, where there is one."""

FIGURES = (
    *OPENING_FIGURES,
    "map.png",
    "timeline.png",
    "errors.png",
    "remains.png",
    *(f"evidence_{name}.png" for name in EFFECTS),
    *(f"remainder_{i}.png" for i in range(1, _MAX_TERM_FIGURES + 1)),
)
"""All figures that a report may have; a new report removes those of an earlier one."""


class Evidence(NamedTuple):
    """The evidence for an effect or a feature term: heading, text, figure."""

    heading: str
    text: str
    figure: Figure


def write_page(result: MismatchResult, out: Path, *, provenance: Provenance | None = None) -> Path:
    """Write `report.html` and its figures into the folder `out`; return the page's path."""
    series = result.series
    before, after = rms(series.before, SETTLING_BINS), rms(series.after, SETTLING_BINS)
    location = [
        _figure(
            out / "map.png",
            "Map of the route; darker where simulation and recording differ more",
            partial(map_figure, result),
        ),
        _figure(
            out / "timeline.png",
            "Residuals of each channel over time, without and with the identified effects, and "
            "the times when each effect is active",
            partial(timeline_figure, result),
        ),
    ]
    errors = _figure(
        out / "errors.png",
        f"Errors {result.horizon_s:g} s ahead on held-out data: "
        f"{' and '.join(model_labels(result))}",
        partial(errors_figure, result),
    )
    residuals = _figure(
        out / "remains.png",
        "RMS residual over noise of each channel, without and with the identified effects",
        partial(unexplained_figure, result, before / series.noise, after / series.noise),
    )
    unexplained, hidden = result.unexplained, result.downweighted
    terms = () if unexplained is None else unexplained.terms
    held_out = result.held_out
    text = render_page(
        "adk_ros.mismatch.report",
        "report.html.j2",
        provenance,
        result=result,
        name=page_title(provenance),
        verdict=verdict_text(result),
        sentence=sentence(result),
        underfit=underfit_channels(result) if result.verdict == NONE else "",
        physics=effect_rows(of_category(result.effects, PHYSICS)),
        calibrations=effect_rows(of_category(result.effects, CALIBRATION)),
        calibration_title=calibration_title(result),
        calibration_header=CALIBRATION_HEADER,
        calibration_rows=calibration_rows(result),
        only_sensor_faults=has_only_sensor_faults(result),
        residual_labels=list(residual_labels(result)),
        trend_labels=trend_labels(result),
        model_labels=list(model_labels(result)),
        tolerance=100.0 * TOLERANCE_BOUND,
        accelerometer_offset=SENSOR_OFFSET_PRIORS["bias_a_x"][1],
        rolling_offset=SENSOR_OFFSET_PRIORS["bias_a_x"][1] / GRAVITY,
        location=location,
        evidence=_evidence(result, out),
        errors=errors,
        residuals=residuals,
        alternatives=[
            (title(one.effect.name), competitor_rows(one), one.gain) for one in result.effects
        ],
        losses=loss_rows(result),
        error_rows=error_rows(result),
        horizon_rows=[] if held_out is None else horizon_rows(held_out),
        refused=held_out is not None and held_out.rejected is not None,
        tolerances_fitted=held_out is not None and held_out.tolerances_fitted,
        judged_model="" if held_out is None else judged_model(held_out),
        held_out_data="the last part" if held_out is None else held_out.source,
        export=FULL if held_out is None else held_out.export,
        formula_exported=(
            held_out is None or held_out.export in {FULL, HALF_TOLERANCES, WITHOUT_TOLERANCES}
        )
        and any(is_transferable(term.feature) for term in terms),
        explained_ratio=MAX_EXPLAINED_RATIO,
        inexact_percent=100.0 * INEXACT_EQUATION_SHARE,
        candidate_rows=candidate_rows(result),
        residual_rows=unexplained_rows(before, after, series.noise),
        unexplained=None if unexplained is None else unexplained_text(unexplained),
        expression="" if unexplained is None else unit_text(unexplained.expression),
        downweighted=None if hidden is None else downweighted_parts(hidden),
        direct_header=DIRECT_HEADER,
        direct=direct_rows(result),
        groups=group_rows(result),
        surrogate=surrogate_rows(result),
        not_judged=listed([title(name) for name in result.not_judged]),
        scope_rows=_scope_rows(result),
        scope_complete=all(row.possible is Possible.YES for row in result.scope),
        drivers=listed([feature(term.feature).description for term in terms]),
        agreement=None if result.agreement is None else agreement_parts(result.agreement),
        manoeuvres=[(title(one.effect.name), one.effect.manoeuvre) for one in result.effects],
        **opening_values(result, out),
    )
    path = out / PAGE
    path.write_text(text, encoding="utf-8")
    return path


def write_scope_page(
    result: MismatchResult, out: Path, *, provenance: Provenance | None = None
) -> Path:
    """Write `report.html` of a result that judges nothing: the scope; return the page's path."""
    text = render_page(
        "adk_ros.mismatch.report",
        "not_judged.html.j2",
        provenance,
        result=result,
        name=page_title(provenance),
        verdict=verdict_text(result),
        sentence=sentence(result),
        surrogate=surrogate_rows(result),
        scope_rows=_scope_rows(result),
    )
    path = out / PAGE
    path.write_text(text, encoding="utf-8")
    return path


def _scope_rows(result: MismatchResult) -> list[list[str]]:
    return [list(row.as_dict().values()) for row in result.scope]


def page_title(provenance: Provenance | None) -> str:
    """
    Return the page's title, with the names of the inputs where they are known.

    Inputs that are named after their roles appear with their parent folders.
    """
    if provenance is None:
        return "Simulation vs recording"
    roles = ("simulation", "recording")
    names = [provenance.source_name(role) or role for role in roles]
    if tuple(names) == roles:
        names = [provenance.parent_and_name(role) or role for role in roles]
    if tuple(names) == roles:
        return "Simulation vs recording"
    return f"Simulation vs recording: {names[0]} vs {names[1]}"


def _figure(path: Path, alt: str, draw: Callable[[Path], None]) -> Figure:
    draw(path)
    return embed(path, alt)


def _evidence(result: MismatchResult, out: Path) -> list[Evidence]:
    """Draw one figure per effect and one per feature term of the unexplained residual."""
    parts = []
    for identified in result.effects:
        item = effect_residual_trend(result.series, identified)
        parts.append(
            Evidence(
                title(identified.effect.name),
                f"Equation: {unit_text(identified.effect.equation)}. "
                f"{_trend_text(item, trend_labels(result))}",
                _figure(
                    out / f"evidence_{identified.effect.name}.png",
                    _alt(item),
                    partial(trend_figure, result, item, identified),
                ),
            )
        )
    terms = result.unexplained.terms if result.unexplained is not None else ()
    for i, term in enumerate(terms[:_MAX_TERM_FIGURES], 1):
        item = feature_residual_trend(result.series, term)
        parts.append(
            Evidence(
                f"Unexplained {EQUATION_TEXTS[term.equation]}",
                _trend_text(item, trend_labels(result)),
                _figure(
                    out / f"remainder_{i}.png",
                    _alt(item),
                    partial(trend_figure, result, item, None),
                ),
            )
        )
    return parts


def _alt(item: Trend) -> str:
    channel = CHANNEL_TITLES[item.channel]
    return f"Mean residual of {channel} against {item.label}, without and with the effect"


def _trend_text(item: Trend, labels: tuple[str, str]) -> str:
    """Return the peak of the binned means in numbers."""
    before = abs(item.before).max() / item.noise
    after = abs(item.after).max() / item.noise
    return (
        f"Figure: {CHANNEL_TITLES[item.channel]} against {item.label}. Peak of the mean residual: "
        f"{before:.2g} times the noise of a 40 ms bin ({labels[0]}), {after:.2g} times "
        f"({labels[1]})."
    )
