# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An identified effect in words: phrase, size, 90 % interval, place or onset, alternatives."""

from __future__ import annotations

import math

from adk_ros.mismatch.inference.result import IdentifiedEffect, Interval
from adk_ros.mismatch.library.categories import CALIBRATION, category_of
from adk_ros.mismatch.library.effect import PLACE, TIME, Effect
from adk_ros.mismatch.report.effect_vocabulary import EFFECT_VOCABULARY, THAN
from adk_ros.mismatch.report.quantities import Quantity
from adk_ros.mismatch.report.recording_texts import onset_text, segment_texts
from adk_ros.mismatch.report.vocabulary import listed, quantity, title

_COUNTS = {2: "two", 3: "three", 4: "four"}


def number(value: float, width: float, show_sign: bool = False) -> str:
    """Return a value with the digits that an interval of this width justifies."""
    sign = "+" if show_sign else ""
    if not (math.isfinite(width) and width > 0.0):
        return f"{value:{sign}.3g}"
    decimals = -math.floor(math.log10(0.5 * width))
    rounded = round(value, decimals) + 0.0  # no minus zero
    return f"{rounded:{sign}.{max(decimals, 0)}f}"


def percent(share: float) -> str:
    """Return a share with two digits."""
    return "less than 0.1 %" if share < 1e-3 else f"{float(f'{100.0 * share:.2g}'):g} %"


def size_and_interval(
    x: Interval, written: Quantity, sign: float = 1.0, show_sign: bool = False
) -> tuple[str, str]:
    """Return ("0.92 m²", "0.88 to 0.97"), all multiplied by `sign`; with `show_sign` "+0.92"."""
    value, low, high = (sign * written.convert(each) for each in (x.value, x.low, x.high))
    low, high = min(low, high), max(low, high)
    # An unbounded end has no digits to give the other numbers.
    width = high - low if abs(high) < 100.0 * abs(value) else abs(value) * 0.1
    first, least, most = (number(each, width, show_sign) for each in (value, low, high))
    size = f"{first} {written.unit}".rstrip()
    if abs(high) >= 100.0 * max(abs(value), 1e-12) and high > 1e3:
        return size, f"at least {least}"
    return size, f"{least} to {most}"


def interval_text(x: Interval, written: Quantity) -> str:
    """Return "0.92 m² (0.88 to 0.97)"; a relative change has a sign: "+20 % (+16 to +24)"."""
    size, interval = size_and_interval(x, written, show_sign=written.is_change)
    return f"{size} ({interval})"


def parameters_text(identified: IdentifiedEffect) -> str:
    """Return all parameters of an effect with their 90 % intervals."""
    parts = []
    for name, x in identified.parameters.items():
        written = quantity(identified.effect.name, name, x.unit)
        parts.append(f"{written.label} {interval_text(x, written)}")
    return listed(parts)


def phrase(effect: Effect, first_value: float) -> str:
    """Return the phrase of an effect whose first parameter has this value."""
    vocabulary = EFFECT_VOCABULARY.get(effect.name)
    if vocabulary is None:
        return title(effect.name)
    below = first_value < effect.parameters[0].neutral
    return vocabulary.opposite if below else vocabulary.phrase


def phrase_size(effect: Effect, first: Interval) -> tuple[str, str]:
    """Return size and 90 % interval of an effect's first parameter, as in its `phrase`."""
    written = quantity(effect.name, effect.parameters[0].name, first.unit)
    sign = -1.0 if first.value < effect.parameters[0].neutral else 1.0
    size, interval = size_and_interval(first, written, sign)
    if written.is_angle:
        size += f" ({written.ratio_or_angle(abs(first.value))})"
    return size, f"{interval} {written.unit}".rstrip()


def effect_text(identified: IdentifiedEffect, reference: bool = False) -> str:
    """
    Return an effect with size, 90 % interval, place or onset, and indistinguishable alternatives.

    With `reference` it says what the size is relative to, which in a list the introduction says.
    """
    effect = identified.effect
    first = next(iter(identified.parameters.values()))
    text = phrase(effect, first.value)
    than = text.endswith(THAN)
    suffix = "" if effect.sensor or not reference else " relative to the simulation"
    suffix = " the simulation" if than and reference else suffix
    text = text if reference else text.removesuffix(THAN).rstrip(",")
    if "{size}" in text:
        size, interval = phrase_size(effect, first)
        text = f"{text.format(size=size)}{suffix} (90 % confidence interval {interval})"
    else:
        text = f"{text}{suffix}, {parameters_text(identified)}"
    where = activation_text(identified)
    text += f", {where}" if where else ""
    if identified.alternatives:
        others = listed(
            [
                _alternative_text(identified, x) + _other_category(effect.name, x)
                for x in identified.alternatives
            ],
            "or",
        )
        text += f", or {others}: not distinguishable in this recording"
    return text


def _alternative_text(identified: IdentifiedEffect, name: str) -> str:
    """Return an alternative with its fitted size, or its title if it was not fitted."""
    fitted = next((x.fitted for x in identified.competitors if x.name == name), None)
    if fitted is None:
        return title(name)
    values = list(fitted.values().values())
    text = phrase(fitted.effect, values[0]).removesuffix(THAN).rstrip(",")
    parameter = fitted.effect.parameters[0]
    if "{size}" not in text:
        return text
    written = quantity(name, parameter.name, parameter.unit)
    # Two digits, and 170 kg instead of 1.7e+02 kg.
    rounded = float(f"{abs(written.convert(values[0])):.2g}")
    size = f"{rounded:g} {written.unit}".rstrip()
    if written.is_angle:
        size += f" ({written.ratio_or_angle(abs(values[0]))})"
    return text.format(size=size)


def _other_category(name: str, alternative: str) -> str:
    """Return the category of an alternative where it is another than that of the effect."""
    category = category_of(alternative)
    if category == category_of(name):
        return ""
    return " (a calibration)" if category == CALIBRATION else " (physics)"


def activation_text(identified: IdentifiedEffect) -> str:
    """Return where or from when an effect acts; nothing if it acts always and everywhere."""
    if identified.kind == PLACE:
        parts = segment_texts(identified)
        return f"at {listed(parts)} of every lap" if parts else "at a place"
    if identified.kind == TIME:
        return onset_text(identified)
    return ""


def effects_text(effects: list[IdentifiedEffect]) -> str:
    """Return the identified effects, numbered if there are several; without a full stop."""
    if len(effects) == 1:
        return effect_text(effects[0], reference=True)
    items = (f"({i}) {effect_text(one)}" for i, one in enumerate(effects, 1))
    count = _COUNTS.get(len(effects), str(len(effects)))
    return f"{count} differences from the simulation: {'; '.join(items)}"
