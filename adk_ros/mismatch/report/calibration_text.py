# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Missing physics and calibrations apart, in words, and what to set for a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from adk_ros.mismatch.inference.result import IdentifiedEffect, MismatchResult
from adk_ros.mismatch.library.categories import (
    AMBIGUOUS,
    CALIBRATION,
    PHYSICS,
    category_of,
    is_ambiguous,
)
from adk_ros.mismatch.library.effect import TIME
from adk_ros.mismatch.report.calibration_parameters import (
    Parameters,
    is_unconditional,
    parameters_by_effect,
)
from adk_ros.mismatch.report.effect_text import effect_text, effects_text
from adk_ros.mismatch.report.recording_texts import onset_text
from adk_ros.mismatch.report.vocabulary import listed, title

_WHERE = "in the parameters of train, replay and the node"


def of_category(effects: Sequence[IdentifiedEffect], category: str) -> list[IdentifiedEffect]:
    """Return the identified effects of a category."""
    return [each for each in effects if category_of(each.effect.name) == category]


def has_ambiguous(effects: Sequence[IdentifiedEffect]) -> bool:
    """Whether one of the effects may be of the other category."""
    return any(is_ambiguous(each.effect.name, each.alternatives) for each in effects)


def shown_text(result: MismatchResult, nothing_else: bool) -> str:
    """
    Return missing physics, then calibrations with what to set; follows "shows", no full stop.

    `nothing_else`: nothing but the identified effects is unexplained.
    """
    physics = of_category(result.effects, PHYSICS)
    calibrations = of_category(result.effects, CALIBRATION)
    if not calibrations:
        return effects_text(physics)
    said = [effect_text(each, reference=True) for each in calibrations]
    items = [f"({i}) {text}" for i, text in enumerate(said, 1)] if len(said) > 1 else said
    text = "; ".join(items)
    settings = " ".join(settings_texts(result)).removesuffix(".")
    text += f". {settings}" if settings else ""
    many = len(calibrations) > 1
    kind = "calibrations" if many else "a calibration"
    ambiguous = has_ambiguous(calibrations)
    if ambiguous:
        kind += " or a difference of the car"
    if physics:
        kind = kind.removeprefix("a ")
        return f"{effects_text(physics)}. {kind[0].upper()}{kind[1:]}: {text}"
    only = nothing_else and not ambiguous
    return f"no missing physics, only {kind}: {text}" if only else f"{kind}: {text}"


def calibration_title(result: MismatchResult) -> str:
    """Return the title of the calibrations' table: some may be a difference of the car."""
    calibrations = of_category(result.effects, CALIBRATION)
    return (
        "Calibration, or a difference of the car" if has_ambiguous(calibrations) else "Calibration"
    )


def settings_texts(result: MismatchResult) -> list[str]:
    """Return what to set for the identified calibrations, in sentences."""
    by_effect = parameters_by_effect(result.effects, result.sensors)
    plain = unconditional_parameters(result)
    out = [f"Set {yaml_text(plain)} {_WHERE}."] if plain else []
    for each in of_category(result.effects, CALIBRATION):
        parameters = by_effect[each.effect.name]
        if not (is_unconditional(each) and parameters):
            out.append(remedy_text(each, parameters))
    return [text for text in out if text]


def unconditional_parameters(result: MismatchResult) -> Parameters:
    """Return the parameters to set for what is a calibration in any case."""
    by_effect = parameters_by_effect(result.effects, result.sensors)
    merged: Parameters = {}
    for each in of_category(result.effects, CALIBRATION):
        if is_unconditional(each):
            merged |= by_effect[each.effect.name]
    return merged


def remedy_text(identified: IdentifiedEffect, parameters: Parameters) -> str:
    """Return what to set for a calibration, and on which condition; a sentence, or nothing."""
    name = identified.effect.name
    if name == "odometry_filter":
        return "No parameter corrects the filter: publish the unfiltered yaw rate."
    if not parameters:
        return ""
    text = f"Set {yaml_text(parameters)} {_WHERE}"
    if identified.kind == TIME:
        text += f" for later recordings (in this one it holds only {onset_text(identified)})"
    physics = [title(x) for x in identified.alternatives if category_of(x) == PHYSICS]
    causes = [f"the cause is {listed(physics, 'or')}"] if physics else []
    if name in AMBIGUOUS:
        causes.insert(0, AMBIGUOUS[name].physics)
        text += f" if {AMBIGUOUS[name].calibration}"
    if causes:
        text += f"; if {listed(causes, 'or')}, it is missing physics: set nothing"
    return f"{text}."


def yaml_text(parameters: Parameters) -> str:
    """Return "gyro_bias: 0.008 and imu_position: [1.2, 0]"."""
    return listed([f"{name}: {_value_text(value)}" for name, value in parameters.items()])


def _value_text(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value_text, value))}]"
    return f"{value:.6g}"


def identified_text(effects: Sequence[IdentifiedEffect], nothing_else: bool) -> str:
    """Return the titles of the effects, counted, calibrations after missing physics."""
    physics, calibrations = (of_category(effects, x) for x in (PHYSICS, CALIBRATION))
    parts = []
    if physics:
        s = "s" if len(physics) > 1 else ""
        parts.append(f"{len(physics)} effect{s} identified: {_titles(physics)}")
    if calibrations:
        s = "s" if len(calibrations) > 1 else ""
        ambiguous = has_ambiguous(calibrations)
        if nothing_else and not physics and not ambiguous:
            parts.append("No missing physics")
        other = ", or a difference of the car" if ambiguous else ""
        parts.append(f"{len(calibrations)} calibration{s}{other}: {_titles(calibrations)}")
    return "; ".join(parts)


def _titles(effects: Sequence[IdentifiedEffect]) -> str:
    return listed(
        [listed([title(x.effect.name), *map(title, x.alternatives)], "or") for x in effects]
    )
