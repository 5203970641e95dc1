# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration of the selection: what effects gain that are present, and effects that are not.

A gain is given as a share of the one required (`MIN_GAIN` and its shares), an excess loss as a
share of the one that counts as explained (`MAX_EXCESS_PER_NOISE`, `MAX_EXCESS_PER_NULL_EXCESS`).
Each should be below 1 on one side and above 1 on the other, except that a formula of an unlisted
effect may be found below it. An effect that is the best on a clean case, or the next after all
effects of the label, is absent.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from adk_ros.mismatch.library.criteria import MAX_EXCESS_PER_NOISE, MAX_EXCESS_PER_NULL_EXCESS

UNKNOWN = "unknown"


@dataclass
class SelectionCalibration:
    """Shares of the required gain and of the explained excess, of all answers that were added."""

    absent: list[float] = field(default_factory=list)
    present: list[float] = field(default_factory=list)
    complete: list[float] = field(default_factory=list)
    incomplete: list[float] = field(default_factory=list)

    def add(self, true: Iterable[str], answer: dict[str, Any]) -> None:
        """Add an answer (the content of mismatch.json); `true`: names of the label."""
        names = set(true)
        found = answer["selection"]
        expected, steps = found["expected_loss"], found["steps"]
        limit = max(
            MAX_EXCESS_PER_NOISE * expected,
            MAX_EXCESS_PER_NULL_EXCESS * (steps[0]["loss"] - expected),
        )
        if UNKNOWN in names:
            self.incomplete.append((steps[-1]["loss"] - expected) / limit)
            return
        for _, step in pairwise(steps):
            gained = step["gain"] / step["required"]
            if not set(step["effects"]) <= names:
                self.absent.append(gained)
                break
            self.present.append(gained)
        self.complete += [
            (step["loss"] - expected) / limit for step in steps if set(step["effects"]) == names
        ]

    def lines(self) -> list[str]:
        """Return a line for the required gain, and one for the explained excess."""
        return [
            f"required gain: {_side(self.absent, 'absent effects', 0.95)} of it, "
            f"{_side(self.present, 'present ones', 0.05)}",
            f"explained excess loss: {_side(self.complete, 'complete results', 0.95)} of it, "
            f"{_side(self.incomplete, 'best ones without what is not listed', 0.05)}",
        ]


def _side(values: Sequence[float], what: str, quantile: float) -> str:
    if not values:
        return f"no {what}"
    verb = "stay below" if quantile > 0.5 else "exceed"
    return f"95 % of {len(values)} {what} {verb} {np.quantile(values, quantile):.2g}"
