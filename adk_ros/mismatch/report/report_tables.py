# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the page's tables: effects, alternatives, hypotheses, errors, residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence

from adk_ros.mismatch.inference.experiment_design import Discriminability
from adk_ros.mismatch.inference.identifiability import CompetingEffect
from adk_ros.mismatch.inference.result import (
    NOT_EXPORTED,
    HeldOutResult,
    IdentifiedEffect,
    MismatchResult,
)
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import DISCRIMINATION_LOSS, INDISTINGUISHABLE_LOSS
from adk_ros.mismatch.library.effect import PLACE, TIME, EffectParameter
from adk_ros.mismatch.recording.sensor_log import CHANNELS, UNITS
from adk_ros.mismatch.report.effect_text import activation_text, interval_text, percent
from adk_ros.mismatch.report.effect_vocabulary import DIRECT_MEASUREMENTS
from adk_ros.mismatch.report.summary import has_only_sensor_faults, pair_text
from adk_ros.mismatch.report.tie_rows import probability_text, tie_rows, value_text
from adk_ros.mismatch.report.vocabulary import (
    CHANNEL_TITLES,
    STATES,
    listed,
    quantity,
    title,
    unit_text,
    with_titles,
)
from adk_ros.numerics.arrays import FloatArray

Rows = list[list[str]]

_MANOEUVRES = {name: effect.manoeuvre for name, effect in EFFECTS.items()}
_CLEAR_LOSS_DIFFERENCE = 200.0
"""Loss difference from which a competing effect fits clearly worse; for the wording only."""
AT_BOUND = ", at the bound of the search"
_BOUND_SHARE = 1e-3
"""Share of the search range within which a fitted value counts as being at its bound."""


def is_at_bound(parameter: EffectParameter, theta: float) -> bool:
    """
    Whether a fitted variable is at a bound of its search.

    A bound at neutral does not count: there the effect is absent.
    """
    low, high = parameter.bounds()
    return any(
        abs(theta - bound) <= _BOUND_SHARE * (high - low) and bound != parameter.theta_neutral
        for bound in (low, high)
    )


def effect_rows(effects: Sequence[IdentifiedEffect]) -> tuple[list[str], Rows]:
    """Return header and rows: effect, parameter, size, ratio or angle, where, confidence."""
    rows = []
    for identified in effects:
        for i, (name, x) in enumerate(identified.parameters.items()):
            written = quantity(identified.effect.name, name, x.unit)
            where = activation_text(identified) or unit_text(identified.effect.where)
            rows.append(
                [
                    title(identified.effect.name) if i == 0 else "",
                    written.label,
                    interval_text(x, written),
                    written.ratio_or_angle(x.value),
                    where if i == 0 else "",
                    probability_text(identified.confidence) if i == 0 else "",
                ]
            )
        rows += tie_rows(identified)
    header = [
        "effect",
        "parameter",
        "size relative to the simulation (90 % interval)",
        "ratio or angle",
        "where",
        "confidence",
    ]
    return without_empty(header, rows, 3)


def without_empty(header: list[str], rows: Rows, column: int) -> tuple[list[str], Rows]:
    """Return a table without the given column if nothing is in it."""
    if any(row[column] for row in rows):
        return header, rows
    header, *rows = ([*row[:column], *row[column + 1 :]] for row in (header, *rows))
    return header, rows


def competitor_rows(identified: IdentifiedEffect) -> Rows:
    """Return alternative, fitted size, share of the loss reduction, loss difference, decision."""
    rows = []
    for competitor in identified.competitors:
        values = []
        if not competitor.fitted.is_material():
            values.append("negligible")
        fitted = zip(competitor.fitted.effect.parameters, competitor.fitted.theta, strict=True)
        for parameter, theta in fitted if not values else ():
            written = quantity(competitor.name, parameter.name, parameter.unit)
            value = value_text(
                competitor.name, parameter.name, parameter.unit, parameter.value(theta)
            )
            text = f"{written.label} {value}"
            values.append(text + (AT_BOUND if is_at_bound(parameter, theta) else ""))
        gain = identified.gain
        share = 1.0 - competitor.loss_difference / gain if gain > 0.0 else 0.0
        rows.append(
            [
                title(competitor.name),
                listed(values),
                f"{100.0 * min(max(share, 0.0), 1.0):.3g} %",
                f"{competitor.loss_difference:,.0f}",
                _decision(competitor, share),
            ]
        )
    return rows


def _decision(competitor: CompetingEffect, share: float) -> str:
    if competitor.alternative:
        return "not distinguishable in this recording"
    if competitor.loss_difference < INDISTINGUISHABLE_LOSS:
        return "rejected: equal fit, but only with a size within build tolerance"
    if share < 0.1:
        return "rejected: almost no loss reduction"
    if share < 0.9:
        return "rejected: only a part of the loss reduction"
    if competitor.loss_difference < _CLEAR_LOSS_DIFFERENCE:
        return "rejected: slightly but significantly worse fit"
    return "rejected: partial fit, residual well above noise"


def loss_rows(result: MismatchResult) -> Rows:
    """Return hypothesis, loss per residual, gain over the row above, decision."""
    rows = []
    selected = len(result.effects)
    has_formula = result.unexplained is not None and bool(result.unexplained.terms)
    previous: float | None = None
    for step in result.steps:
        names, loss = step.names, step.loss
        gain = "" if previous is None else f"{previous - loss:,.0f}"
        decision = "selected" if len(names) == selected else ""
        if decision and has_formula:
            decision = "selected, with a formula for the remaining residual"
        if len(names) > selected:
            why = "gain too small" if step.gain <= step.required else "not supported by all data"
            why = "a formula fits the remaining residual better" if has_formula else why
            decision = f"rejected: {why}"
        ratio = loss / result.expected_loss if result.expected_loss > 0.0 else math.nan
        rows.append(
            [
                listed([title(each) for each in names]) or "no effect, build tolerance only",
                f"{ratio:.3f}",
                gain,
                decision,
            ]
        )
        previous = loss
    return rows


def error_rows(result: MismatchResult) -> Rows:
    """Return state, held-out error before and after, reduction."""
    rows = []
    for name, (state, unit) in STATES.items():
        before, after = result.before[name], result.after[name]
        if not math.isfinite(before):
            rows.append([f"{state} ({unit})", "not evaluated", "", ""])
            continue
        reduction = f"{round(100.0 * (1.0 - after / before)) if before > 0.0 else 0} %"
        if has_only_sensor_faults(result):
            reduction = "not applicable"
        rows.append([f"{state} ({unit})", *pair_text(before, after), reduction])
    return rows


def horizon_rows(held_out: HeldOutResult) -> Rows:
    """
    Return state, horizon, errors, whether consistent.

    Errors: before, after, with the refused correction if there is one, expected, persistence.
    """
    refused = [] if held_out.rejected is None else [held_out.rejected]
    rows = []
    for name, (state, unit) in STATES.items():
        for i, horizon in enumerate(held_out.horizons_s):
            before = held_out.before[name][i]
            if not math.isfinite(before):
                continue
            ratio = held_out.ratio[name][i]
            rows.append(
                [
                    f"{state} ({unit})" if i == 0 else "",
                    f"{horizon:g} s",
                    f"{before:.2g}",
                    *(
                        f"{x:.2g}" if math.isfinite(x) else ""
                        for x in (
                            held_out.after[name][i],
                            *(errors[name][i] for errors in refused),
                            held_out.expected[name][i],
                            held_out.persistence[name][i],
                        )
                    ),
                    "" if not math.isfinite(ratio) else "yes" if ratio <= 1.0 else "no",
                ]
            )
    return rows


def judged_model(held_out: HeldOutResult) -> str:
    """Return which model's errors are compared with what noise explains."""
    if held_out.rejected is not None:
        return "refused correction"
    if held_out.tolerances_fitted:
        return "simulation with the build tolerances that the training part shows"
    return "simulation" if held_out.export == NOT_EXPORTED else "corrected vehicle model"


def candidate_rows(result: MismatchResult) -> Rows:
    """Return effect, size with interval, share of the excess loss, why it is rejected."""
    rows = []
    for candidate in result.candidates:
        sizes = []
        for name, x in candidate.parameters.items():
            written = quantity(candidate.name, name, x.unit)
            at_bound = any(
                is_at_bound(p, p.theta(x.value))
                for p in EFFECTS[candidate.name].parameters
                if p.name == name
            )
            sizes.append(
                f"{written.label} {interval_text(x, written)}{AT_BOUND if at_bound else ''}"
            )
        where = {PLACE: ", in segments of the lap", TIME: ", from a time on"}
        rows.append(
            [
                title(candidate.name),
                listed(sizes) + where.get(candidate.kind, ""),
                percent(min(candidate.share, 1.0)),
                with_titles(candidate.reason),
            ]
        )
    return rows


def unexplained_rows(before: FloatArray, after: FloatArray, noise: FloatArray) -> Rows:
    """Return channel, RMS residual (6,) before and after, noise, residual after over noise."""
    rows = []
    for i, name in enumerate(CHANNELS):
        channel = f"{CHANNEL_TITLES[name]} ({unit_text(UNITS[i])})"
        if before[i] == after[i] == 0.0:
            # A channel without weight: what it needs is missing from the recording.
            rows.append([channel, "not evaluated", "", f"{noise[i]:.3g}", ""])
            continue
        ratio = f"{after[i] / max(noise[i], 1e-12):.2f}"
        rows.append([channel, f"{before[i]:.3g}", f"{after[i]:.3g}", f"{noise[i]:.3g}", ratio])
    return rows


def surrogate_rows(result: MismatchResult) -> Rows:
    """Return channel, RMS error of the surrogate on the simulation, noise of the recording."""
    return [
        [
            f"{CHANNEL_TITLES[name]} ({unit_text(UNITS[i])})",
            f"{result.surrogate_error[name]:.2g}",
            f"{result.series.noise[i]:.2g}",
        ]
        for i, name in enumerate(CHANNELS)
    ]


def discriminability_text(item: Discriminability) -> str:
    """Return which simulated manoeuvre distinguishes two effects, or that none does."""
    other = title(item.other)
    if item.distinguishes:
        return (
            f"from {other}: {item.manoeuvre} (simulated loss difference {item.loss:,.0f}; "
            f"{DISCRIMINATION_LOSS:g} is enough)"
        )
    return (
        f"from {other}: none of {item.tried} simulated manoeuvres; the best is {item.manoeuvre} "
        f"(loss difference {item.loss:,.0f}; {DISCRIMINATION_LOSS:g} is needed)"
    )


def group_rows(result: MismatchResult) -> Rows:
    """Return indistinguishable effects, distinguishing manoeuvre, other ways to distinguish."""
    rows = []
    for group in result.groups:
        simulated = [x for x in result.discriminability if x.of == group[0]]
        # The usual manoeuvres are of no use if no simulated manoeuvre distinguishes the effects.
        undecided = simulated and not any(x.distinguishes for x in simulated)
        ways = DIRECT_MEASUREMENTS if undecided else _MANOEUVRES
        others = [f"{title(name)}: {ways[name]}" for name in group if ways.get(name)]
        rows.append(
            [
                listed([title(name) for name in group], "or"),
                "; ".join(discriminability_text(x) for x in simulated) or "-",
                "; ".join(others) or "-",
            ]
        )
    return rows
