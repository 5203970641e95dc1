# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The answer in a sentence or two: the same on the terminal and on top of the page."""

from __future__ import annotations

import math

from adk_ros.mismatch.inference.result import (
    EXPLAINED,
    NONE,
    UNKNOWN,
    IdentifiedEffect,
    Interval,
    MismatchResult,
    UnexplainedResidual,
)
from adk_ros.mismatch.inference.unmodelled import EQUATION_TEXTS as EQUATION_WORDS
from adk_ros.mismatch.library.effect import PLACE, TIME
from adk_ros.mismatch.library.features import FEATURES
from adk_ros.mismatch.recording.sensor_log import CHANNELS, UNITS
from adk_ros.mismatch.report.vocabulary import CHANNELS as CHANNEL_WORDS
from adk_ros.mismatch.report.vocabulary import (
    EFFECT_VOCABULARY,
    STATES,
    THAN,
    Quantity,
    listed,
    quantity,
    title,
)

MAX_ERROR_TO_NOISE = 2.0
"""The stand-in misses a simulation that it is off by so many times a bin's noise."""
MAX_IMPROVED_RATIO = 0.98
"""An error this many times smaller than before, or less, has fallen."""


def number(value: float, width: float) -> str:
    """Return a value with as many digits as an interval of this width leaves it."""
    if not (math.isfinite(width) and width > 0.0):
        return f"{value:.3g}"
    decimals = -math.floor(math.log10(0.5 * width))
    rounded = round(value, decimals)
    return f"{rounded:.{max(decimals, 0)}f}"


def interval_text(x: Interval, said: Quantity) -> str:
    """Return "0.92 m2 (0.88 to 0.97)"."""
    value, low, high = (said.factor * each for each in (x.value, x.low, x.high))
    # An end that is out of sight has no digits to give the others.
    wide = high - low if abs(high) < 100.0 * abs(value) else abs(value) * 0.1
    unit = f" {said.unit}" if said.unit else ""
    if abs(high) >= 100.0 * max(abs(value), 1e-12) and high > 1e3:
        return f"{number(value, wide)}{unit} (at least {number(low, wide)})"
    return f"{number(value, wide)}{unit} ({number(low, wide)} to {number(high, wide)})"


def parameters_text(found: IdentifiedEffect) -> str:
    """Return the effect's parameters with their 90 % intervals."""
    parts = []
    for name, x in found.parameters.items():
        said = quantity(found.effect.name, name, x.unit)
        parts.append(f"{said.label} {interval_text(x, said)}")
    return listed(parts)


def phrase(found: IdentifiedEffect) -> str:
    """Return what the recording has; ends in "than" if it compares with the simulation."""
    words = EFFECT_VOCABULARY.get(found.effect.name)
    if words is None:
        return title(found.effect.name)
    first = next(iter(found.effect.parameters))
    x = found.parameters.get(first.name)
    below = x is not None and x.value < first.neutral
    return words.opposite if below else words.phrase


def segment_texts(found: IdentifiedEffect) -> list[str]:
    """Return "306 to 617 m" for each stretch, within the lap; "1700 m over the start to 60 m"."""
    lap = found.lap_m
    parts = []
    for begin, end in sorted((a % lap, b % lap) if lap else (a, b) for a, b in found.segments):
        over = " m over the start" if end < begin else ""
        parts.append(f"{begin:.0f}{over} to {end:.0f} m")
    return parts


def activation_text(found: IdentifiedEffect) -> str:
    """Return where it acts, or nothing where it acts throughout."""
    if found.kind == PLACE:
        parts = segment_texts(found)
        return f"at {listed(parts)} of every lap" if parts else "at a place"
    if found.kind == TIME:
        return f"from {found.onset_s or 0.0:.1f} s on"
    return ""


def _values(found: IdentifiedEffect) -> str:
    where = activation_text(found)
    return parameters_text(found) + (f", {where}" if where else "")


def effects_text(effects: list[IdentifiedEffect]) -> str:
    """Return what the recording has, with values; without a stop at the end."""
    if len(effects) == 1:
        (one,) = effects
        what = phrase(one)
        lacks = " the simulation" if what.endswith(THAN) else " that the simulation lacks"
        if one.effect.sensor:
            lacks = " the simulation" if what.endswith(THAN) else ""
        return f"{what}{lacks}: {_values(one)}"
    parts = [f"{phrase(one).removesuffix(THAN)}, {_values(one)}" for one in effects]
    return f"{_COUNTS.get(len(parts), str(len(parts)))} things that the simulation lacks: " + (
        "; ".join(f"({i}) {part}" for i, part in enumerate(parts, 1))
    )


_COUNTS = {2: "two", 3: "three", 4: "four"}


def worst_channel(findings: MismatchResult) -> str:
    """Return the state whose error falls most, as a share."""
    judged = [name for name, value in findings.before.items() if math.isfinite(value)]
    return max(
        judged or list(findings.before),
        key=lambda name: findings.before[name] / max(findings.after[name], 1e-9),
    )


def gain_text(findings: MismatchResult) -> str:
    """Return by how much the corrected simulation is better, on held-out data."""
    name = worst_channel(findings)
    what, unit = STATES.get(name, (name, ""))
    before, after = findings.before[name], findings.after[name]
    error = f"the {findings.horizon_s:g} s {what} error"
    if after < MAX_IMPROVED_RATIO * before:
        first, second = pair_text(before, after)
        return f"{error} falls from {first} to {second} {unit}"
    stays = f"{error} stays at {before:.2g} {unit}"
    if findings.verdict == EXPLAINED and all(found.effect.sensor for found in findings.effects):
        return f"a sensor's fault is not corrected into the car, so {stays}"
    return stays


def pair_text(before: float, after: float) -> tuple[str, str]:
    """Return two errors with as many decimals as give the smaller one two digits."""
    if not (0.0 < after < math.inf and 0.0 < before < math.inf):
        return f"{before:.3g}", f"{after:.3g}"
    decimals = 1 - math.floor(math.log10(min(before, after)))
    most = 3 - math.floor(math.log10(max(before, after)))
    places = max(min(decimals, most), 0)
    first, second = (
        f"{x:.{places}f}" if x >= 10.0**-places else f"{x:.2g}" for x in (before, after)
    )
    return first, second


def unexplained_text(rest: UnexplainedResidual) -> str:
    """Return what an unexplained remainder is and what it goes with."""
    if not rest.terms:
        return rest.text
    goes: dict[str, list[str]] = {}
    for piece in rest.terms:
        goes.setdefault(piece.equation, []).append(FEATURES[piece.feature].description)
    return listed(
        [
            f"a {EQUATION_WORDS[equation]} that goes with {listed(features)}"
            for equation, features in goes.items()
        ]
    )


def _ties(effects: list[IdentifiedEffect]) -> str:
    parts = []
    for found in effects:
        if found.alternatives:
            names = listed([title(name) for name in found.alternatives], "or")
            parts.append(f" This drive cannot tell {title(found.effect.name)} from {names}.")
    return "".join(parts)


def _lacks(findings: MismatchResult) -> str:
    if not findings.missing_channels:
        return ""
    return (
        f" The recording is judged without {listed([x.what for x in findings.missing_channels])}."
    )


def underfit_channels(findings: MismatchResult) -> str:
    """Return in which channels the stand-in misses the simulation, and by how much; or nothing."""
    return listed(
        [
            f"{CHANNEL_WORDS[name]} ({findings.surrogate_error[name]:.2g} {unit.replace('^', '')})"
            for name, unit, noise in zip(CHANNELS, UNITS, findings.series.noise, strict=True)
            if findings.surrogate_error[name] > MAX_ERROR_TO_NOISE * noise
        ]
    )


def sentence(findings: MismatchResult) -> str:
    """
    Return the answer in a sentence.

    More say what the drive cannot tell apart, and what the recording is judged without.
    """
    lacks = _lacks(findings)
    if findings.verdict == NONE:
        judged = math.isfinite(findings.before["v_x"])
        what, unit = STATES["v_x" if judged else "yaw_rate"]
        error = findings.before["v_x" if judged else "yaw_rate"]
        missed = underfit_channels(findings)
        if missed:
            return (
                "Nothing is found, but little could be: the stand-in misses the simulation's own "
                f"recording in {missed}, and what is smaller than that hides in it "
                f"({findings.horizon_s:g} s {what} error {error:.2g} {unit}).{lacks}"
            )
        return (
            "Nothing material is missing from the simulation: build tolerance and the sensors' "
            f"noise explain what differs ({findings.horizon_s:g} s {what} error "
            f"{error:.2g} {unit}).{lacks}"
        )
    gain = gain_text(findings)
    ties = _ties(findings.effects) + lacks
    if findings.verdict == UNKNOWN and findings.unexplained is not None:
        rest = findings.unexplained
        formula = f", as {rest.expression}" if rest.expression else ""
        also = f" It also has {effects_text(findings.effects)}." if findings.effects else ""
        return (
            "The recording has something that the simulation lacks and no known effect explains: "
            f"{unexplained_text(rest)}{formula}; with it, {gain}.{also}{ties}"
        )
    return f"The recording has {effects_text(findings.effects)}; {gain}.{ties}"
