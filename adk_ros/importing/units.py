# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Units of a source, as pint reads them and as loggers write them, and their factor to SI."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

from adk_ros.errors import UsageError
from adk_ros.importing.channels import ACCELERATION, ANGLE, DEGREE, QUANTITIES, RATE, SHARE, TORQUE
from adk_ros.importing.optional_library import optional_library

_ALIASES = {
    "nm": "N m", "n·m": "N m", "knm": "kN m", "kn·m": "kN m", "n m": "N m",
    "°": "deg", "grad": "deg", "degree": "deg", "degrees": "deg", "degs": "deg",
    "°/s": "deg/s", "grad/s": "deg/s", "dps": "deg/s", "deg/sec": "deg/s", "°/sec": "deg/s",
    "rad/sec": "rad/s", "kmh": "km/h", "kph": "km/h", "km/hr": "km/h", "m/sec": "m/s",
    "m/s2": "m/s^2", "m/s²": "m/s^2", "m/s/s": "m/s^2", "m/s**2": "m/s^2", "m/sec2": "m/s^2",
    "u/min": "rpm", "1/min": "rpm", "min-1": "rpm", "min^-1": "rpm", "rev/min": "rpm",
    "-": "1", "": "1", "ratio": "1", "pct": "%", "percent": "%", "mbar": "mbar",
    "meter": "m", "meters": "m", "metre": "m",
}  # fmt: skip
"""Lower-case spelling of a logger -> spelling of pint. Degrees are Grad in German, not gon."""

_OF_ACCELERATION = {"g": "standard_gravity", "mg": "millistandard_gravity"}
"""In an acceleration, g is no gram."""

_UNIT = re.compile(r"[^\x00-\x1f]{0,40}")


def factor_to_si(unit: str, si: str) -> float:
    """
    Return the factor from a unit to an SI unit of `channels`: 1 exactly if they are the same.

    A torque also accepts 1 and %, for a pedal position in its place.

    :raises UsageError: the unit is unknown, or measures something else. The message does not say
        where.
    """
    spelling = canonical_unit(unit, si)
    if spelling == si:
        return 1.0
    factor, of = _factor(spelling, si), si
    if factor is None and si == TORQUE:
        factor, of = _factor(spelling, SHARE), SHARE
    if factor is not None and _is_angular(spelling) == (of in {ANGLE, RATE, DEGREE}):
        return factor
    if _quantity(spelling) is None:
        raise UsageError(f"unit '{unit}' is unknown")
    raise UsageError(f"unit '{unit}' does not fit: {QUANTITIES[si]}, is needed")


def is_unit_of(unit: str, si: str) -> bool:
    """Return whether a unit measures the same as an SI unit."""
    try:
        factor_to_si(unit, si)
    except UsageError:
        return False
    return si != TORQUE or _factor(canonical_unit(unit), SHARE) is None


def _is_angular(unit: str) -> bool:
    """Return whether a unit is one of angles, which pint takes for numbers."""
    return any(word in unit for word in ("rad", "deg", "rpm", "turn", "rev"))


def canonical_unit(unit: str, si: str = "") -> str:
    """Return a unit in the spelling that pint knows; `si`: of the channel that it is for."""
    text = " ".join(unit.split())
    if si == ACCELERATION and text.lower() in _OF_ACCELERATION:
        return _OF_ACCELERATION[text.lower()]
    return _ALIASES.get(text.lower(), text)


@lru_cache(maxsize=1)
def _registry() -> Any:
    return optional_library("pint", "the conversion of units").UnitRegistry()


@lru_cache(maxsize=256)
def _quantity(unit: str) -> Any:
    """Return what pint makes of a unit; None if it does not know it."""
    registry = _registry()
    if not _UNIT.fullmatch(unit):
        return None
    try:
        parsed = registry.Quantity(1.0, registry.parse_units(unit))
        return parsed.to_base_units()
    except Exception:  # text of a stranger: pint raises whatever its parser meets
        return None


@lru_cache(maxsize=256)
def _factor(unit: str, si: str) -> float | None:
    """Return the factor between two units; None if there is none."""
    source, target = _quantity(unit), _quantity(si)
    if source is None or target is None or source.dimensionality != target.dimensionality:
        return None
    registry = _registry()
    try:
        # Of two values, so that a scale with an offset such as °C is no factor.
        zero = registry.Quantity(0.0, registry.parse_units(unit)).to(si).magnitude
        one = registry.Quantity(1.0, registry.parse_units(unit)).to(si).magnitude
    except Exception:  # as above
        return None
    return float(one) if zero == 0.0 and one > 0.0 else None
