# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How the rate of false alarms of a fleet is divided among the tests of an analysis.

Each question, whether an effect is that of all cars, of a car, of a condition, of a time or of a
place, has an equal share of `criteria.FAMILYWISE_ERROR_RATE`, divided by the number of its tests:
Bonferroni's inequality with weights (C. R. Genovese, K. Roeder, L. Wasserman, "False discovery
control with p-value weighting", Biometrika 93 (2006) 509). So what all cars share is not less
significant because many cars, days and places are examined as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from adk_ros.fleet.inference.levels import Level, is_trend
from adk_ros.mismatch.library.criteria import FAMILYWISE_ERROR_RATE

_TREND, _PLACE = "trend", "place"


@dataclass(frozen=True)
class ErrorRates:
    """Number of tests of each question that is asked."""

    counts: Mapping[str, int]

    @classmethod
    def of(cls, levels: Sequence[Level], parameters: int, at_places: int) -> ErrorRates:
        """Return those of every parameter at every level, and of tests at places."""
        counts = Counter(question_of(level) for level in levels)
        tests = {question: parameters * count for question, count in counts.items()}
        return cls({q: n for q, n in {**tests, _PLACE: at_places}.items() if n > 0})

    @property
    def tests(self) -> int:
        """Number of all tests."""
        return max(sum(self.counts.values()), 1)

    @property
    def largest(self) -> float:
        """Largest p-value that is significant for any question."""
        return max(map(self._of, self.counts), default=FAMILYWISE_ERROR_RATE)

    @property
    def of_place(self) -> float:
        """Largest p-value of a significant test at a place."""
        return self._of(_PLACE)

    def of_level(self, level: Level) -> float:
        """Return the largest p-value of a significant candidate at a level."""
        return self._of(question_of(level))

    def tests_of(self, level: Level) -> int:
        """Return the number of tests of the question that a level belongs to."""
        return self.counts.get(question_of(level), 1)

    def _of(self, question: str) -> float:
        share = FAMILYWISE_ERROR_RATE / max(len(self.counts), 1)
        return share / max(self.counts.get(question, 1), 1)


def question_of(level: Level) -> str:
    """Return which question it is whether an effect acts at a level."""
    return _TREND if is_trend(level) else level.kind
