# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a parameter is written: label, unit and conversion from SI."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple


def _unchanged(value: float) -> float:
    return value


def percent_change(ratio: float) -> float:
    """Return a ratio as a relative change, %."""
    return 100.0 * (ratio - 1.0)


def _percent_slope(angle: float) -> float:
    return 100.0 * math.tan(angle)


def kilowatts(watts: float) -> float:
    """Return a power in kW."""
    return 1e-3 * watts


class Quantity(NamedTuple):
    """
    How a parameter is written.

    `convert` is an increasing function from the SI value to the number that is shown in `unit`.
    """

    label: str
    unit: str
    convert: Callable[[float], float] = _unchanged
    is_angle: bool = False
    is_ratio: bool = False

    @property
    def is_change(self) -> bool:
        """Whether it is a relative change, which tables show with its sign."""
        return self.convert is percent_change

    def ratio_or_angle(self, value: float) -> str:
        """Return a relative change as a ratio, an angle in degrees, or ""."""
        if self.is_angle:
            return f"{math.degrees(value):.2g}°"
        if self.is_ratio:
            return f"ratio {value:.3g}"
        return ""


def change(label: str) -> Quantity:
    """Return a ratio, written as a relative change."""
    return Quantity(label, "%", percent_change, is_ratio=True)


def angle(label: str) -> Quantity:
    """Return an angle in rad, with degrees where there is room."""
    return Quantity(label, "rad", is_angle=True)


def slope(label: str) -> Quantity:
    """Return an angle of a road, written as a slope."""
    return Quantity(label, "%", _percent_slope, is_angle=True)
