# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Names of effects, parameters, channels and units in texts for people."""

from __future__ import annotations

import re

from adk_ros.mismatch.report.effect_vocabulary import EFFECT_VOCABULARY
from adk_ros.mismatch.report.quantities import Quantity

CHANNEL_TITLES = {
    "imu_a_x": "IMU longitudinal acceleration",
    "imu_a_y": "IMU lateral acceleration",
    "imu_yaw_rate": "IMU yaw rate",
    "v_x": "odometry speed",
    "v_y": "odometry lateral velocity",
    "yaw_rate": "odometry yaw rate",
}
"""Names of the residual channels."""

STATES = {
    "v_x": ("speed", "m/s"),
    "v_y": ("lateral velocity", "m/s"),
    "yaw_rate": ("yaw rate", "rad/s"),
}
"""Name and unit of each predicted state."""

_PRODUCTS = {"N m": "N·m", "kg m": "kg·m", "rad s": "rad·s"}
_SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹"


def title(name: str) -> str:
    """Return the title of an effect; for a name without vocabulary, the name in words."""
    return EFFECT_VOCABULARY[name].title if name in EFFECT_VOCABULARY else name.replace("_", " ")


def with_titles(text: str) -> str:
    """Return a text with the names of effects replaced by their titles."""
    return re.sub(r"\b[a-z]+(?:_[a-z]+)*\b", lambda found: _title_of(found[0]), text)


def _title_of(word: str) -> str:
    return EFFECT_VOCABULARY[word].title if word in EFFECT_VOCABULARY else word


def unit_text(unit: str) -> str:
    """Return a unit or formula as it is typeset: "m/s^2" as "m/s²"; "-" as nothing."""
    if unit == "-":
        return ""
    for plain, typeset in _PRODUCTS.items():
        unit = unit.replace(plain, typeset)
    return re.sub(r"\^(\d)", lambda found: _SUPERSCRIPTS[int(found[1])], unit)


def quantity(effect: str, parameter: str, unit: str) -> Quantity:
    """Return how a parameter is written; `unit` is for a parameter without vocabulary."""
    vocabulary = EFFECT_VOCABULARY.get(effect)
    if vocabulary is not None and parameter in vocabulary.quantities:
        return vocabulary.quantities[parameter]
    return Quantity(parameter.replace("_", " "), unit_text(unit))


def listed(items: list[str], last: str = "and") -> str:
    """Return "a, b and c"."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"
