# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration of the selection: what effects gain that are present, and effects that are not.

Each criterion of `library.criteria` is compared with the same quantity on both sides: it should
lie above what absent effects reach, and below what present ones reach. An effect that is the next
best on a clean case, or after all effects of the label, is absent.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from adk_ros.mismatch.library import criteria

UNKNOWN = "unknown"
_GAINS = (
    "MIN_GAIN",
    "MIN_GAIN_PER_SURROGATE_ERROR",
    "MIN_GAIN_PER_EXCESS",
    "MIN_GAIN_PER_NULL_EXCESS",
)
_EXCESSES = ("MAX_EXCESS_PER_NOISE", "MAX_EXCESS_PER_NULL_EXCESS")


@dataclass
class Sides:
    """Values of one quantity: of absent effects or complete results, and of the contrary."""

    below: list[float] = field(default_factory=list)
    above: list[float] = field(default_factory=list)

    def line(self, name: str, low: str, high: str) -> str:
        """Return both sides in words: the 95 % quantile below, the 5 % quantile above."""
        parts = [f"{name} {getattr(criteria, name):g}:"]
        if self.below:
            parts.append(f"95 % of {len(self.below)} {low} stay below {_at(self.below, 0.95)}")
        if self.above:
            parts.append(f"95 % of {len(self.above)} {high} exceed {_at(self.above, 0.05)}")
        return f"{parts[0]} {', '.join(parts[1:]) or 'no case'}"


def _at(values: list[float], quantile: float) -> str:
    return f"{np.quantile(values, quantile):.3g}"


@dataclass
class SelectionCalibration:
    """The quantities of all selections that were added, by criterion."""

    sides: dict[str, Sides] = field(
        default_factory=lambda: {name: Sides() for name in (*_GAINS, *_EXCESSES)}
    )

    def add(self, true: Iterable[str], answer: dict[str, Any]) -> None:
        """Add an answer (the content of mismatch.json); `true`: names of the label."""
        names = set(true)
        found = answer["selection"]
        expected, steps = found["expected_loss"], found["steps"]
        null = max(steps[0]["loss"] - expected, 1.0)
        for before, step in itertools.pairwise(steps):
            if UNKNOWN in names:
                break
            excess = max(before["loss"] - expected, 1.0)
            units = (1.0, max(found["surrogate_error"], 1.0), excess, null)
            present = set(step["effects"]) <= names
            for name, unit in zip(_GAINS, units, strict=True):
                side = self.sides[name]
                (side.above if present else side.below).append(step["gain"] / unit)
            if not present:
                break
        complete = [step for step in steps if set(step["effects"]) == names]
        left = (complete or steps)[-1]["loss"] - expected
        if not complete and UNKNOWN not in names:
            return
        for name, unit in zip(_EXCESSES, (expected, null), strict=True):
            side = self.sides[name]
            (side.below if complete else side.above).append(left / unit)

    def lines(self) -> list[str]:
        """Return a line per criterion."""
        return [
            *(self.sides[x].line(x, "absent effects", "present ones") for x in _GAINS),
            *(
                self.sides[x].line(x, "complete results", "results without what is not listed")
                for x in _EXCESSES
            ),
        ]
