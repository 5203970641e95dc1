# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Agreement of several recordings: a sentence, the page's tables, the content of the JSON file."""

from __future__ import annotations

import math
from typing import Any

from adk_ros.mismatch.inference.result import (
    Agreement,
    Interval,
    ParameterAgreement,
    RecordingSpan,
)
from adk_ros.mismatch.report.effect_text import interval_text, size_and_interval
from adk_ros.mismatch.report.json_values import json_interval, json_number
from adk_ros.mismatch.report.quantities import Quantity
from adk_ros.mismatch.report.summary import pair_text
from adk_ros.mismatch.report.vocabulary import STATES, listed, quantity, title

Rows = list[list[str]]


def agreement_text(agreement: Agreement | None) -> str:
    """Return in one or two sentences whether the recordings agree; nothing for one recording."""
    if agreement is None or not agreement.parameters:
        return ""
    names = [span.name for span in agreement.recordings]
    compared = [row for row in agreement.parameters if not math.isnan(row.q)]
    disagreeing = [row for row in compared if row.disagree]
    if disagreeing:
        return " ".join(_disagreement(row, names) for row in disagreeing)
    if not compared:
        return "No effect acts in more than one recording, so its size cannot be compared."
    least = min(row.p_value for row in compared)
    return f"{listed(names)} agree on {_what(compared)} (Cochran's Q test, {_p_text(least)})."


def _what(rows: list[ParameterAgreement]) -> str:
    return listed(list(dict.fromkeys(f"the size of {title(row.effect)}" for row in rows)))


def _disagreement(row: ParameterAgreement, names: list[str]) -> str:
    written = _written(row)
    test = f"Cochran's Q test, {_p_text(row.p_value)}"
    shown = {i: x for i, x in enumerate(row.each) if x is not None}
    if row.odd is not None:
        size, _ = size_and_interval(shown[row.odd], written)
        interval = shown[row.odd]
        others, _ = size_and_interval(
            Interval(row.others, *_around(row.others, interval), interval.unit), written
        )
        rest = listed([names[i] for i in shown if i != row.odd])
        return (
            f"{names[row.odd]} differs in {written.label} of {title(row.effect)}: {size} against "
            f"{others} in {rest} ({test})."
        )
    sizes = [f"{interval_text(x, written)} in {names[i]}" for i, x in shown.items()]
    what = f"{written.label} of {title(row.effect)}"
    if not row.claimed:
        return (
            f"The recordings disagree on {what}, the best single effect, which is therefore not "
            f"claimed with one size: {listed(sizes)} ({test}). Analyse them separately."
        )
    return (
        f"The recordings disagree on {what}: {listed(sizes)} ({test}). The joint size is a mean "
        "of different sizes."
    )


def _around(value: float, x: Interval) -> tuple[float, float]:
    """Return an interval of the width of another one, for the number of digits."""
    half = 0.5 * (x.high - x.low)
    return value - half, value + half


def _written(row: ParameterAgreement) -> Quantity:
    return quantity(row.effect, row.parameter, row.joint.unit)


def _p_text(p: float) -> str:
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def agreement_rows(agreement: Agreement) -> tuple[list[str], Rows]:
    """Return header and rows: effect, parameter, size in each recording, jointly, the test."""
    header = [
        "effect",
        "parameter",
        *(span.name for span in agreement.recordings),
        "all recordings",
        "Cochran's Q",
        "p",
        "I²",
    ]
    rows = []
    for row in agreement.parameters:
        written = _written(row)
        sizes = ["does not act" if x is None else interval_text(x, written) for x in row.each]
        test = ["", "", ""]
        if not math.isnan(row.q):
            test = [f"{row.q:.1f}", _p_text(row.p_value), f"{100.0 * row.i_squared:.0f} %"]
        joint = interval_text(row.joint, written)
        name = title(row.effect) if row.claimed else f"{title(row.effect)} (not claimed)"
        rows.append([name, written.label, *sizes, joint, *test])
    return header, rows


def agreement_parts(agreement: Agreement) -> dict[str, Any]:
    """Return what the page's section on several recordings shows."""
    header, rows = agreement_rows(agreement)
    return {
        "text": agreement_text(agreement),
        "header": header,
        "rows": rows,
        "left_out": left_out_rows(agreement),
        "spans": listed([_span_text(span) for span in agreement.recordings]),
    }


def _span_text(span: RecordingSpan) -> str:
    route = "no lap" if span.route is None else f"route {span.route + 1}"
    return f"{span.name} ({span.begin_s:.0f} to {span.end_s:.0f} s, {route})"


def left_out_rows(agreement: Agreement) -> Rows:
    """Return rows: recording, state, error of the simulation, error corrected by the others."""
    rows = []
    for span, errors in zip(agreement.recordings, agreement.left_out, strict=False):
        for name, (state, unit) in STATES.items():
            first, second = pair_text(errors.before[name], errors.after[name])
            rows.append([span.name, state, f"{first} {unit}", f"{second} {unit}"])
    return rows


def agreement_dict(agreement: Agreement) -> dict[str, Any]:
    """Return the key `agreement` of `mismatch.json`."""
    return {
        "recordings": [
            {
                "name": span.name,
                "begin_s": json_number(span.begin_s),
                "end_s": json_number(span.end_s),
                "route": span.route,
                "lap_m": None if span.lap_m is None else json_number(span.lap_m),
            }
            for span in agreement.recordings
        ],
        "parameters": [
            {
                "effect": row.effect,
                "parameter": row.parameter,
                "unit": row.joint.unit,
                "each": [None if x is None else json_interval(x) for x in row.each],
                "joint": json_interval(row.joint),
                "q": json_number(row.q),
                "p_value": json_number(row.p_value),
                "i_squared": json_number(row.i_squared),
                "claimed": row.claimed,
                "agree": None if math.isnan(row.q) else not row.disagree,
            }
            for row in agreement.parameters
        ],
        "left_out": [
            {
                "before": {name: json_number(x) for name, x in errors.before.items()},
                "after": {name: json_number(x) for name, x in errors.after.items()},
            }
            for errors in agreement.left_out
        ],
        "text": agreement_text(agreement),
    }
