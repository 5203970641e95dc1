# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Direct comparisons as evidence: differences that the result says nothing about.

A surrogate model that fits the simulation poorly hides what is smaller than its error; a direct
comparison needs no surrogate. Where it shows a significant difference that no claim covers, the
result must not stay silent.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from adk_ros.mismatch.recording.direct_comparison import DirectComparison


def uncovered(
    comparisons: Sequence[DirectComparison],
    claimed: Collection[str],
    unexplained_equations: Collection[str] = (),
) -> list[DirectComparison]:
    """
    Return the comparisons with a significant difference that no claim covers.

    `claimed`: effects of the result with their alternatives; one that changes the quantity covers
    it, and so does an unexplained residual in one of its equations.
    """
    return [
        comparison
        for comparison in comparisons
        if comparison.differs
        and not set(claimed) & set(comparison.effects)
        and not set(unexplained_equations) & set(comparison.equations)
    ]
