# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An acceptance criterion with its verdict, as the benchmarks print it: one line."""

from __future__ import annotations

from dataclasses import dataclass

PASS, FAIL, INFO = "PASS", "FAIL", "INFO"
CRITERIA_FILE, EARLIER_CRITERIA_FILE = "criteria.txt", "bars.txt"
"""File of the criteria in results of a benchmark, and its name in those of 0.1.0."""


@dataclass(frozen=True)
class Criterion:
    """One result: `verdict` is PASS, FAIL, or INFO if there is no criterion."""

    verdict: str
    name: str
    figure: str

    @staticmethod
    def judged(passed: bool, name: str, figure: str) -> Criterion:
        """Return a criterion that is met or missed."""
        return Criterion(PASS if passed else FAIL, name, figure)

    def __str__(self) -> str:
        return f"{self.verdict} {self.name} {self.figure}"
