# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the page says in rows: effects, rivals, what each effect gains, errors, what remains."""

from __future__ import annotations

import math

from adk_ros.mismatch.inference.experiment_design import DISCRIMINATION_LOSS, Discriminability
from adk_ros.mismatch.inference.identifiability import INDISTINGUISHABLE_LOSS, CompetingEffect
from adk_ros.mismatch.inference.result import NONE, IdentifiedEffect, MismatchResult
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.recording.sensor_log import CHANNELS, UNITS
from adk_ros.mismatch.report.summary import activation_text, interval_text, pair_text
from adk_ros.mismatch.report.vocabulary import CHANNEL_TEXTS, STATES, listed, quantity, title
from adk_ros.mismatch.report.vocabulary import CHANNELS as CHANNEL_WORDS
from adk_ros.numerics.arrays import FloatArray

Rows = list[list[str]]

_MANOEUVRES = {name: effect.manoeuvre for name, effect in EFFECTS.items()}
_CLEAR = 200.0
"""Loss difference from which a rival is no question."""
_OTHERWISE = {"rad": (180.0 / math.pi, "deg"), "rad/s": (180.0 / math.pi, "deg/s")}


def effect_rows(findings: MismatchResult) -> Rows:
    """Return effect, parameter, value with interval, in other units, where, confidence."""
    rows = []
    for found in findings.effects:
        for i, (name, x) in enumerate(found.parameters.items()):
            said = quantity(found.effect.name, name, x.unit)
            rows.append(
                [
                    title(found.effect.name) if i == 0 else "",
                    said.label,
                    interval_text(x, said),
                    _alternative_text(name, x.value, x.unit),
                    (activation_text(found) or found.effect.where) if i == 0 else "",
                    f"{100.0 * found.confidence:.0f} %" if i == 0 else "",
                ]
            )
    return rows


def _alternative_text(name: str, value: float, unit: str) -> str:
    if name in {"grade", "bank"}:
        return f"{100.0 * math.tan(value):.1f} %"
    factor, other = _OTHERWISE.get(unit, (0.0, ""))
    if other:
        return f"{value * factor:.3g} {other}"
    if name in {"scale", "mu_scale"}:
        return f"{100.0 * (value - 1.0):+.1f} %"
    return ""


def competitor_rows(found: IdentifiedEffect) -> Rows:
    """Return rival, its fitted values, its share of what the effect explains, and the verdict."""
    rows = []
    for rival in found.competitors:
        values = []
        if not rival.fitted.is_material():
            values.append("next to nothing of it")
        for parameter in rival.fitted.effect.parameters if not values else ():
            said = quantity(rival.name, parameter.name, parameter.unit)
            value = said.factor * rival.fitted.values()[parameter.name]
            values.append(f"{said.label} {value:.3g} {said.unit}".rstrip())
        share = 1.0 - rival.loss_difference / found.gain if found.gain > 0.0 else 0.0
        rows.append(
            [
                title(rival.name),
                listed(values),
                f"{100.0 * min(max(share, 0.0), 1.0):.3g} %",
                f"{rival.loss_difference:,.0f}",
                _rejection_reason(rival, share),
            ]
        )
    return rows


def _rejection_reason(rival: CompetingEffect, share: float) -> str:
    if rival.alternative:
        return "fits as well: cannot be told apart on this drive"
    if rival.loss_difference < INDISTINGUISHABLE_LOSS:
        return "fits as well, but only with a value within build tolerance"
    if share < 0.1:
        return "explains next to nothing"
    if share < 0.9:
        return "explains a part only"
    if rival.loss_difference < _CLEAR:
        return "fits nearly as well; the difference is more than chance"
    return "fits much, but what it leaves is far more than noise"


def loss_rows(findings: MismatchResult) -> Rows:
    """Return hypothesis, loss over a perfect model's, gain on the one above, and the verdict."""
    rows = []
    taken = len(findings.effects)
    before: float | None = None
    for name, loss in findings.losses:
        names = [] if name == NONE else name.split("+")
        gain = "" if before is None else f"{before - loss:,.0f}"
        so = "taken" if len(names) == taken else ""
        if so and findings.unexplained is not None:
            so = "taken, with a formula for what is left"
        if len(names) > taken:
            so = "not taken: " + (
                "what is left fits a formula better"
                if findings.unexplained is not None
                else "gains too little"
            )
        ratio = loss / findings.expected_loss if findings.expected_loss > 0.0 else math.nan
        rows.append(
            [
                listed([title(each) for each in names]) or "nothing but build tolerance",
                f"{ratio:.3f}",
                gain,
                so,
            ]
        )
        before = loss
    return rows


def error_rows(findings: MismatchResult) -> Rows:
    """Return state, held-out error before, after, and the share that is gone."""
    rows = []
    for name, (what, unit) in STATES.items():
        before, after = findings.before[name], findings.after[name]
        if not math.isfinite(before):
            rows.append([f"{what} ({unit})", "not judged", "", ""])
            continue
        gone = 100.0 * (1.0 - after / before) if before > 0.0 else 0.0
        rows.append([f"{what} ({unit})", *pair_text(before, after), f"{gone:.0f} %"])
    return rows


def unexplained_rows(before: FloatArray, after: FloatArray, noise: FloatArray) -> Rows:
    """Return channel, RMS residual (6,) before and after, noise, and the ratio that is left."""
    rows = []
    for i, name in enumerate(CHANNELS):
        unit = UNITS[i].replace("^", "")
        rows.append(
            [
                f"{CHANNEL_WORDS[name]} ({unit})",
                f"{before[i]:.3g}",
                f"{after[i]:.3g}",
                f"{noise[i]:.3g}",
                f"{after[i] / max(noise[i], 1e-12):.2f}",
            ]
        )
    return rows


def surrogate_rows(findings: MismatchResult) -> Rows:
    """Return channel, the stand-in's RMS error on the simulation, and the recording's noise."""
    return [
        [
            f"{CHANNEL_WORDS[name]} ({UNITS[i].replace('^', '')})",
            f"{findings.surrogate_error[name]:.2g}",
            f"{findings.series.noise[i]:.2g}",
        ]
        for i, name in enumerate(CHANNELS)
    ]


def discriminability_text(item: Discriminability) -> str:
    """Return what simulating manoeuvres has shown of a pair."""
    other = title(item.other)
    if item.distinguishes:
        return (
            f"from {other}: {item.manoeuvre} (simulated with either, the two differ by "
            f"{item.loss:,.0f} in loss, where {DISCRIMINATION_LOSS:g} tells them apart)"
        )
    return (
        f"from {other}: none of {item.tried} simulated manoeuvres; the best, {item.manoeuvre}, "
        f"differs by {item.loss:,.0f} in loss, and {DISCRIMINATION_LOSS:g} would be needed"
    )


def group_rows(findings: MismatchResult) -> Rows:
    """Return effects that the drive cannot tell apart, and what would tell each."""
    rows = []
    for group in findings.groups:
        shown = [discriminability_text(x) for x in findings.discriminability if x.of == group[0]]
        driven = [x.distinguishes for x in findings.discriminability if x.of == group[0]]
        # What is usually driven for an effect is of no use where nothing driven tells it here.
        known = CHANNEL_TEXTS if driven and not any(driven) else _MANOEUVRES
        tells = [f"{title(name)}: {known[name]}" for name in group if known.get(name)]
        rows.append(
            [
                listed([title(name) for name in group], "or"),
                "; ".join(shown) or "-",
                "; ".join(tells) or "-",
            ]
        )
    return rows
