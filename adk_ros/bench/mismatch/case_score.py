# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One answer against one label.

A name counts one where it is found, and its share where it stands among the alternatives of a
found one: 1 / (1 + number of alternatives); a found name with alternatives counts that share too.
Set-F1 is 2 right / (named + labelled). A parameter's error is relative to its size, the difference
from where nothing acts. Where something acts is compared as a set of times: intersection over
union. `unknown` in a label asks for the verdict `unknown`, and where the label says so for the
equation and for what drives it; an empty label for `none`.

A label may say besides: `strength` (share of full size, 1 unless said), `plant` (which simulator
made it), and of an effect `unknown` its `equations` and what it is `driven_by` (names of
`mismatch.correction.FEATURES`, any of which will do).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from adk_ros.mismatch.inference.unmodelled import EQUATION_TEXTS
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.features import FEATURES

UNKNOWN = "unknown"
_RESOLUTION_S = 0.01


@dataclass
class CaseResult:
    """
    One case's score.

    `kind`: none, single, pair, triple or unknown. `right` between 0 and 1; `f1` of the names;
    `errors` relative by parameter; `covered` whether its 90 % interval holds the true value;
    `iou` by effect; `removed` the share of the removable held-out error that is gone, by channel;
    `described` whether an unlisted effect's equation and driving variable are right, None where
    the label does not say them; `strength` and `plant` as in the label.
    """

    case: str
    kind: str
    right: float
    f1: float
    reported: str
    label: str
    errors: dict[str, float] = field(default_factory=dict)
    covered: dict[str, bool] = field(default_factory=dict)
    iou: dict[str, float] = field(default_factory=dict)
    removed: dict[str, float] = field(default_factory=dict)
    seconds: float = math.nan
    cpu_s: float = math.nan
    memory_mib: float = math.nan
    failure: str = ""
    strength: float = 1.0
    plant: str = ""
    described: bool | None = None
    baselines: list[dict[str, Any]] = field(default_factory=list)
    """Rows of `rivals.Beside`, ours first, where other methods were run as well."""
    correctable: bool = True
    """Whether anything but a sensor's fault is concealed, which no correction removes."""


def kind_of(label: dict[str, Any]) -> str:
    """Return what a label asks for."""
    names = [effect["name"] for effect in label["effects"]]
    if UNKNOWN in names:
        return UNKNOWN
    return ("none", "single", "pair", "triple")[min(len(names), 3)]


def overlap(a: list[list[float]], b: list[list[float]], end_s: float) -> float:
    """Return the intersection over union of two sets of times within [0, `end_s`]."""
    n = int(end_s / _RESOLUTION_S) + 1
    sets = []
    for intervals in (a, b):
        inside = bytearray(n)
        for begin, stop in intervals:
            first = max(round(begin / _RESOLUTION_S), 0)
            last = min(round(stop / _RESOLUTION_S), n)
            inside[first:last] = b"\x01" * max(last - first, 0)
        sets.append(inside)
    both = sum(1 for x, y in zip(*sets, strict=True) if x and y)
    either = sum(1 for x, y in zip(*sets, strict=True) if x or y)
    return both / either if either else 1.0


def shares(name: str, found: list[dict[str, Any]]) -> float:
    """Return what a labelled name counts among the effects found."""
    best = 0.0
    for effect in found:
        alternatives = list(effect.get("alternatives", []))
        if name == effect["name"] or name in alternatives:
            best = max(best, 1.0 / (1 + len(alternatives)))
    return best


def described(label: dict[str, Any], answer: dict[str, Any]) -> bool | None:
    """
    Return whether an answer's remainder is in the label's equation and goes with what drives it.

    The most telling equation has to be one of the label's, and one of the features of that
    equation one that the label takes. None where the label says neither.
    """
    asked: dict[str, Any] = next((e for e in label["effects"] if e["name"] == UNKNOWN), {})
    equations, drivers = asked.get("equations", []), asked.get("driven_by", [])
    if not equations and not drivers:
        return None
    rest = answer.get("unexplained", {})
    first = next(iter(rest.get("equations", [])), "")
    if equations and first not in equations:
        return False
    begins = f"{EQUATION_TEXTS.get(first, '')} against "
    goes_with = {
        part.removeprefix(begins)
        for part in rest.get("text", "").split("; ")
        if part.startswith(begins)
    }
    return not drivers or any(FEATURES[name].description in goes_with for name in drivers)


def _neutral(effect: str, parameter: str) -> float:
    for known in EFFECTS[effect].parameters if effect in EFFECTS else ():
        if known.name == parameter and not known.inverse:
            return known.neutral
    return 0.0


def score_case(case: str, label: dict[str, Any], answer: dict[str, Any]) -> CaseResult:
    """Score an answer (the content of mismatch.json)."""
    kind = kind_of(label)
    found = list(answer.get("effects", []))
    wanted = [effect for effect in label["effects"] if effect["name"] != UNKNOWN]
    counts = [shares(effect["name"], found) for effect in wanted]
    named = len(found)
    both = named + len(wanted)
    f1 = 2.0 * sum(counts) / both if both else 1.0
    verdict = answer.get("verdict", "")
    if kind == "none":
        right = float(verdict == "none" and not found)
    elif kind == UNKNOWN:
        right = float(verdict == "unknown" and described(label, answer) is not False)
    elif named == len(wanted) and verdict == "explained":
        right = math.prod(counts)
    else:
        right = 0.0
    said = " + ".join(
        "|".join([effect["name"], *effect.get("alternatives", [])]) for effect in found
    )
    if verdict == "unknown":
        rest = answer.get("unexplained", {})
        said = f"unknown({','.join(rest.get('equations', []))}) {said}".strip()
    result = CaseResult(
        case,
        kind,
        right,
        f1,
        said or verdict,
        " + ".join(effect["name"] for effect in label["effects"]) or "none",
        strength=float(label.get("strength", 1.0)),
        plant=str(label.get("plant", "")),
        described=described(label, answer) if verdict == UNKNOWN == kind else None,
        correctable=any(
            effect["name"] not in EFFECTS or not EFFECTS[effect["name"]].sensor
            for effect in label["effects"]
        ),
    )
    end_s = max((t[1] for e in wanted for t in e["time_intervals_s"]), default=0.0)
    for effect in wanted:
        match = next((x for x in found if x["name"] == effect["name"]), None)
        if match is None:
            continue
        for name, true in effect["params"].items():
            given = match["parameters"].get(name)
            if given is None or given["value"] is None:
                continue
            size = abs(true - _neutral(effect["name"], name))
            if size > 0.0:
                key = f"{effect['name']}.{name}"
                result.errors[key] = abs(given["value"] - true) / size
                result.covered[key] = bool(given["low"] <= true <= given["high"])
        if effect["kind"] in {"place", "time"}:
            result.iou[effect["name"]] = overlap(
                effect["time_intervals_s"], match["where"]["time_intervals_s"], end_s
            )
    return result
