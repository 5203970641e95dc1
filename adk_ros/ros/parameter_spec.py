# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A parameter of the node: name, default, range, description, and conversion of its values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from adk_ros.errors import UsageError

Value = str | bool | int | float | list[float] | list[str]


@dataclass(frozen=True)
class ParameterSpec:
    """
    One parameter. The type of `default` is the parameter's type; for a list, of its elements.

    `low` and `high` bound a number and each number of a list; `default` gives the length of a
    list of numbers. `live`: can be changed while the node runs; all others are fixed at start-up.
    """

    name: str
    default: Value
    text: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    live: bool = False

    @property
    def expected(self) -> str:
        """Description of the accepted values, for messages."""
        if self.choices:
            return "one of " + ", ".join(repr(choice) for choice in self.choices)
        if isinstance(self.default, list):
            if isinstance(self.default[0], str):
                return "a list of at least one name"
            return f"a list of {len(self.default)} numbers{self._range}"
        words = {bool: "true or false", int: "a whole number", float: "a number", str: "a string"}
        return words[type(self.default)] + self._range

    @property
    def _range(self) -> str:
        return f" from {self.low:g} to {self.high:g}" if math.isfinite(self.high) else ""

    def convert(self, value: Any) -> Value:
        """
        Return `value` in the type of the parameter; whole numbers are accepted for real ones.

        :raises UsageError: it does not fit; the message names the parameter and the value.
        """
        converted = self._converted(value)
        if converted is None:
            given = "empty" if value is None else repr(as_list(value))
            raise UsageError(f"parameter '{self.name}' is {given}: give {self.expected}")
        return converted

    def _converted(self, value: Any) -> Value | None:
        default = self.default
        if isinstance(default, bool):
            return value if isinstance(value, bool) else None
        if isinstance(default, str):
            fits = isinstance(value, str) and (not self.choices or value in self.choices)
            return value if fits else None
        if isinstance(default, list):
            items = [value] if isinstance(value, str) else as_list(value)
            if not isinstance(items, list):
                return None
            if isinstance(default[0], str):
                names = [item for item in items if isinstance(item, str) and item]
                return names if names and len(names) == len(items) else None
            numbers = [self._number(item) for item in items]
            valid = [number for number in numbers if number is not None]
            return valid if len(valid) == len(items) == len(default) else None
        number = self._number(value)
        if number is None or isinstance(default, float):
            return number
        return int(number) if number == int(number) else None

    def _number(self, value: Any) -> float | None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        # A whole number of YAML may be too large for a float.
        fits = self.low <= value <= self.high and abs(value) < math.inf
        try:
            return float(value) if fits else None
        except OverflowError:
            return None


def as_list(value: Any) -> Any:
    """Return an array as a list (ROS delivers array.array); any other value unchanged."""
    return list(value) if hasattr(value, "__iter__") and not isinstance(value, str) else value
