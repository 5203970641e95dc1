# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Score one answer of `adk mismatch` against the label of a case.

A reported name counts 1, or 1 / (1 + number of alternatives) if it has indistinguishable
alternatives; so does a labelled name among the alternatives. Alternatives that no drive can
separate from it (`INSEPARABLE`), or the case's own provably cannot (`proven_ties`), do not reduce
the credit. Set-F1 is 2 right / (reported + labelled). The
error of a parameter is relative to its distance from the neutral value. Activation is compared as
a set of times by intersection over union. The label `unknown` expects the verdict `unknown` and,
where the label gives them, the equation, the driving variable and the form of the dependence; an
empty label expects `none`.

Optional keys of a label: `strength` (fraction of full strength, default 1), `plant` (simulator),
`noise` (multiple of the usual), and for `unknown` its `equations`, `driven_by` (names in
`FEATURES`, `time` or `distance`) and `forms` (see `unlisted_labels`), any of which is right, or
for a faulty sensor `accepts`: the verdicts that are right without a named effect.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

from adk_ros.bench.mismatch.reliability import ScoredClaim
from adk_ros.bench.mismatch.unlisted_labels import DISTANCE, EPISODES, TIME
from adk_ros.mismatch.inference.feature_effect import EQUATION_TEXTS
from adk_ros.mismatch.library.catalogue import EFFECTS, INSEPARABLE
from adk_ros.mismatch.library.features import FEATURES, feature

UNKNOWN = "unknown"
MEMORY_WORDS = (
    "where the", "while", "with a lag of", "with a hysteresis of", "beyond", "that oscillates",
    "that changes", "that fades", "from", "until", "every",
)  # fmt: skip
"""Words that follow a feature's description if the feature acts with a memory or in a part."""
_VARIABLES = {
    TIME: re.compile(
        r"^time: |oscillat(ion|es) in time| with the time over | (from|until) [\d.e+]+ s$"
    ),
    DISTANCE: re.compile(r"oscillat(ion|es) every [\d.e+]+ m travelled$"),
}
"""Driving variable that is no feature -> how a description states it."""
_RESOLUTION_S = 0.01
"""Time resolution of the intersection over union, s."""


@dataclass
class CaseResult:
    """
    Score of one case.

    `kind`: none, single, pair, triple or unknown; `right`: 0 to 1; `f1`: of the names; `errors`:
    relative, by parameter; `covered`: whether the 90 % interval contains the true value; `iou`: by
    effect; `removed`: share of the removable held-out error removed by the correction, by channel;
    `described`, `formed`: whether equation and driving variable of an unlisted effect, and the
    form of the dependence, are right, None if the label has none; `strength`, `plant` and `noise`:
    as in the label.
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
    noise: float = math.nan
    described: bool | None = None
    formed: bool | None = None
    baselines: list[dict[str, Any]] = field(default_factory=list)
    """`BaselineResult` of each method as a dict, `adk mismatch` first, if baselines were run."""
    correctable: bool = True
    """Whether anything but sensor faults is injected: no correction removes those."""
    claims: list[ScoredClaim] = field(default_factory=list)
    """Named effects with confidence."""
    raised: float = math.nan
    """Largest relative increase of a state's error by the correction, at the horizon that the
    report states first; negative if it falls in every state, NaN without errors."""
    raised_elsewhere: float = math.nan
    """The same over all horizons of the report."""
    raised_held_out: float = math.nan
    """Like `raised`, on the held-out recording of the case."""
    proven: list[str] = field(default_factory=list)
    """Reported alternatives that the recording provably cannot separate from the effect."""
    detectable: bool | None = None
    """Whether the injected effect reaches its detectable size; None if that is not known."""


def kind_of(label: dict[str, Any]) -> str:
    """Return the kind of a label: none, single, pair, triple or unknown."""
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


def shares(name: str, found: list[dict[str, Any]], proven: Collection[str] = ()) -> float:
    """
    Return the credit for a labelled name, given the reported effects.

    `proven`: alternatives that the recording provably cannot separate from it.
    """
    best = 0.0
    for effect in found:
        alternatives = list(effect.get("alternatives", []))
        members = {effect["name"], *alternatives}
        if name in members:
            tied = next((tie for tie in INSEPARABLE if name in tie), frozenset()) | set(proven)
            best = max(best, 1.0 / (1 + len(members - tied - {name})))
    return best


def described(label: dict[str, Any], answer: dict[str, Any]) -> bool | None:
    """
    Return whether the unmodelled dynamics of an answer have the labelled equation and variable.

    The first equation must be among those of the label, and one of its features among the driving
    variables of the label. None if the label has neither.
    """
    expected = _unknown_of(label)
    equations, drivers = expected.get("equations", []), expected.get("driven_by", [])
    if not equations and not drivers:
        return None
    unexplained = answer.get("unexplained", {})
    first = next(iter(unexplained.get("equations", [])), "")
    if equations and first not in equations:
        return False
    prefix = f"{EQUATION_TEXTS.get(first, '')} against "
    variables = {
        part.removeprefix(prefix)
        for part in unexplained.get("text", "").split("; ")
        if part.startswith(prefix)
    }
    return not drivers or any(_is_of(text, name) for text in variables for name in drivers)


def formed(label: dict[str, Any], answer: dict[str, Any]) -> bool | None:
    """
    Return whether a term of an answer that depends on a labelled variable has a labelled form.

    None if the label has no forms.
    """
    expected = _unknown_of(label)
    forms, drivers = expected.get("forms", []), expected.get("driven_by", [])
    if not forms:
        return None
    unexplained = answer.get("unexplained", {})
    terms = unexplained.get("terms", [])
    if not terms:
        return EPISODES in forms and "against time: " in unexplained.get("text", "")
    return any(
        term["form"] in forms
        and any(_is_of(feature(term["feature"]).description, name) for name in drivers)
        for term in terms
    )


def _unknown_of(label: dict[str, Any]) -> dict[str, Any]:
    """Return the unlisted effect of a label, or nothing."""
    return next((effect for effect in label["effects"] if effect["name"] == UNKNOWN), {})


def _is_of(text: str, variable: str) -> bool:
    """Whether a text describes a variable, its threshold, its memory or a mass that it moves."""
    if variable in _VARIABLES:
        return _VARIABLES[variable].search(text) is not None
    description = FEATURES[variable].description
    if text == description or f" moved by {description} (" in text:
        return True
    return any(text.startswith(f"{description} {words} ") for words in MEMORY_WORDS)


def scored_claims(label: dict[str, Any], answer: dict[str, Any]) -> list[ScoredClaim]:
    """
    Return the named effects of an answer that state a confidence.

    It is that of the effect or one of its alternatives. It is right if the label has the effect,
    or an alternative by which no other claim is right: two claims for one effect are not both.
    """
    labelled = {effect["name"] for effect in label["effects"]}
    effects = answer.get("effects", [])
    used = labelled & {effect["name"] for effect in effects}
    claims = []
    for effect in effects:
        names = [effect["name"], *effect.get("alternatives", [])]
        right = effect["name"] in labelled
        if not right and (free := labelled.intersection(names) - used):
            right = True
            used.add(min(free, key=names.index))
        if effect.get("confidence") is not None:
            claims.append(ScoredClaim("|".join(names), float(effect["confidence"]), right))
    return claims


def raised_error(answer: dict[str, Any], *, all_horizons: bool = False) -> float:
    """Return the largest relative increase of a state's error that an answer states, or NaN."""
    fit = answer.get("fit", {})
    pairs = [fit, *(fit.get("horizons", {}).values() if all_horizons else ())]
    increases = [
        pair["after"][state] / before - 1.0
        for pair in pairs
        for state, before in pair.get("before", {}).items()
        if before and pair.get("after", {}).get(state) is not None
    ]
    return max(increases, default=math.nan)


def detectable(label: dict[str, Any], sizes: dict[tuple[str, str], float]) -> bool | None:
    """
    Return whether the single labelled effect reaches its detectable size in any parameter.

    `sizes`: by effect and parameter, the difference from neutral; of a parameter that enters by
    its inverse, the largest detectable value; NaN if no size is detectable. None if the effect
    has no size.
    """
    (effect,) = label["effects"]
    name = effect["name"]
    given = {p: size for (other, p), size in sizes.items() if other == name}
    if not given:
        return None
    inverse = {p.name for p in EFFECTS[name].parameters if p.inverse}
    return any(
        true <= given[p] if p in inverse else abs(true - _neutral(name, p)) >= given[p]
        for p, true in effect["params"].items()
        if p in given
    )


def _neutral(effect: str, parameter: str) -> float:
    for known in EFFECTS[effect].parameters if effect in EFFECTS else ():
        if known.name == parameter and not known.inverse:
            return known.neutral
    return 0.0


def score_case(
    case: str, label: dict[str, Any], answer: dict[str, Any], proven: Sequence[str] = ()
) -> CaseResult:
    """
    Score an answer (the content of mismatch.json).

    `proven`: alternatives that the recording provably cannot separate from the single effect.
    """
    kind = kind_of(label)
    found = list(answer.get("effects", []))
    wanted = [effect for effect in label["effects"] if effect["name"] != UNKNOWN]
    counts = [shares(effect["name"], found, proven) for effect in wanted]
    named = len(found)
    both = named + len(wanted)
    f1 = 2.0 * sum(counts) / both if both else 1.0
    verdict = answer.get("verdict", "")
    accepts = [x for effect in label["effects"] for x in effect.get("accepts", [])]
    if kind == "none":
        right = float(verdict == "none" and not found)
    elif accepts:
        right = float(verdict in accepts and not found)
    elif kind == UNKNOWN:
        stated = described(label, answer) is not False and formed(label, answer) is not False
        right = float(verdict == "unknown" and stated)
    elif named == len(wanted) and verdict == "explained":
        right = math.prod(counts)
    else:
        right = 0.0
    reported = " + ".join(
        "|".join([effect["name"], *effect.get("alternatives", [])]) for effect in found
    )
    if verdict == "unknown":
        equations = answer.get("unexplained", {}).get("equations", [])
        reported = f"unknown({','.join(equations)}) {reported}".strip()
    result = CaseResult(
        case,
        kind,
        right,
        f1,
        reported or verdict,
        " + ".join(effect["name"] for effect in label["effects"]) or "none",
        strength=float(label.get("strength", 1.0)),
        plant=str(label.get("plant", "")),
        noise=float(label.get("noise", math.nan)),
        described=described(label, answer) if verdict == UNKNOWN == kind else None,
        formed=formed(label, answer) if verdict == UNKNOWN == kind else None,
        correctable=any(
            not (EFFECTS[effect["name"]].sensor if effect["name"] in EFFECTS else False)
            and not effect.get("sensor")
            for effect in label["effects"]
        ),
        claims=scored_claims(label, answer),
        raised=raised_error(answer),
        raised_elsewhere=raised_error(answer, all_horizons=True),
        proven=list(proven),
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
