# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Answers to questions for single effects, as sentences and as rows of a table."""

from __future__ import annotations

from typing import NamedTuple

from adk_ros.mismatch.inference.asked_effect import FORMULA, AskedEffect, AskedFit
from adk_ros.mismatch.inference.required_size import MAX_MORE_DRIVING
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import DISCRIMINATION_LOSS
from adk_ros.mismatch.library.effect import PLACE, TIME
from adk_ros.mismatch.report.effect_text import interval_text, percent, phrase
from adk_ros.mismatch.report.effect_vocabulary import DIRECT_MEASUREMENTS, THAN
from adk_ros.mismatch.report.tie_rows import MAX_SHOWN, NO_LIMIT
from adk_ros.mismatch.report.vocabulary import listed, quantity, title, with_titles

HEADER = [
    "fit",
    "size (90 % interval)",
    "where",
    "share of the excess loss removed",
    "gain in loss",
    "required gain",
]


class Answer(NamedTuple):
    """An answer for the page: heading, verdict, reason, rows of `HEADER`, what would decide."""

    heading: str
    verdict: str
    reason: str
    rows: list[list[str]]
    needs: list[str]


def answer_of(asked: AskedEffect) -> Answer:
    """Return the answer as its parts."""
    rows = [_row(asked.name, "alone", asked.alone)] if asked.alone is not None else []
    if asked.added is not None:
        # The first column does not wrap on a narrow screen.
        names = _next_to(asked).replace(FORMULA, "the formula")
        rows.append(_row(asked.name, f"next to {names}", asked.added))
    verdict = "claimed" if asked.claimed else "not claimed"
    return Answer(
        title(asked.name),
        verdict,
        with_titles(asked.reason),
        rows,
        [] if not rows else needs(asked),
    )


def asked_text(asked: AskedEffect) -> str:
    """Return the answer in a few sentences, for the terminal."""
    answer = answer_of(asked)
    first = answer.heading[:1].upper() + answer.heading[1:]
    parts = [f"{first} is {answer.verdict}: {answer.reason}."]
    fit = asked.decisive
    if fit is not None:
        names = _next_to(asked)
        context = f"Fitted next to {names}" if names else "Fitted alone"
        parts.append(
            f"{context}: {sizes_text(asked.name, fit)}; it removes {percent(fit.share)} of the "
            f"excess loss. Its gain in loss, less a penalty for each fitted value, is "
            f"{fit.gain:,.0f}; a claim requires {fit.required:,.0f}."
        )
    parts += [f"{need[:1].upper()}{need[1:]}." for need in answer.needs]
    return " ".join(parts)


def sizes_text(name: str, fit: AskedFit) -> str:
    """Return the sizes of a fit with their 90 % intervals."""
    sizes = []
    for parameter, x in fit.parameters.items():
        written = quantity(name, parameter, x.unit)
        text = NO_LIMIT if abs(x.value) > MAX_SHOWN else interval_text(x, written)
        sizes.append(f"{written.label} {text}")
    return listed(sizes)


def _row(name: str, label: str, fit: AskedFit) -> list[str]:
    return [
        label,
        sizes_text(name, fit),
        where_text(fit),
        percent(fit.share),
        f"{fit.gain:,.0f}",
        f"{fit.required:,.0f}",
    ]


def where_text(fit: AskedFit) -> str:
    """Return where or when a fitted effect acts."""
    if fit.kind == PLACE:
        ends = [f"{a:.0f}\u00a0to\u00a0{b:.0f}\u00a0m" for a, b in fit.segments]
        return f"{listed(ends)} of the lap"
    if fit.kind == TIME:
        return f"from {fit.onset_s or 0.0:.1f} s on"
    return "always"


def needs(asked: AskedEffect) -> list[str]:
    """Return what would decide: a size, more driving, a manoeuvre, a direct measurement."""
    fit = asked.decisive
    if fit is None or asked.claimed:
        return [] if fit is None else [_detectable_text(asked.name, fit)]
    out = [_detectable_text(asked.name, fit)]
    if fit.is_material and fit.is_nonzero and not fit.suffices:
        out.append(_driving_text(fit))
    elif not fit.is_nonzero:
        out.append(
            "more driving only narrows the interval, which contains zero: a smaller effect could "
            "be found, but nothing points to one"
        )
    out += _manoeuvre_texts(asked)
    if asked.name in DIRECT_MEASUREMENTS:
        out.append(f"direct measurement: {DIRECT_MEASUREMENTS[asked.name]}")
    return [text for text in out if text]


def _next_to(asked: AskedEffect) -> str:
    return listed([name if name == FORMULA else title(name) for name in asked.next_to])


def _detectable_text(name: str, fit: AskedFit) -> str:
    known = []
    effect = EFFECTS[name]
    for parameter in effect.parameters:
        value = fit.detectable[parameter.name]
        if value is None:
            continue
        written = quantity(name, parameter.name, parameter.unit)
        size = f"{float(f'{abs(written.convert(value)):.2g}'):g} {written.unit}".rstrip()
        angle = f" ({written.ratio_or_angle(abs(value))})" if written.is_angle else ""
        text = phrase(effect, value).removesuffix(THAN).rstrip(",")
        if "{size}" not in text:
            text = f"{written.label} ±{{size}}"
        known.append(text.format(size=f"{size}{angle}"))
    if not known:
        return "on this recording no size within the range of the search would be claimed"
    return f"on this recording it would be claimed from about {listed(known, 'or')}"


def _driving_text(fit: AskedFit) -> str:
    if fit.more_driving is None:
        return (
            "more driving of the same kind does not decide it, even "
            f"{MAX_MORE_DRIVING:g} times as much: the required gain grows with the unexplained "
            "residual and the surrogate model's own error"
        )
    return (
        f"with {fit.more_driving:.1f} times as much driving of the same kind, an effect of this "
        "size would be claimed"
    )


def _manoeuvre_texts(asked: AskedEffect) -> list[str]:
    found = asked.distinguishing
    if found is None:
        return []
    against = (
        "no effect"
        if found.other == found.of
        else title(found.of if found.other == asked.name else found.other)
    )
    if not found.distinguishes:
        return [
            f"none of {found.tried} simulated manoeuvres separates it from {against}; the best is "
            f"{found.manoeuvre} (it changes the loss by {found.loss:,.0f}; "
            f"{DISCRIMINATION_LOSS:.0f} is needed)"
        ]
    return [
        f"the manoeuvre that best separates it from {against}: {found.manoeuvre} (in a "
        f"simulation it changes the loss by {found.loss:,.0f}; {DISCRIMINATION_LOSS:.0f} suffice)"
    ]
