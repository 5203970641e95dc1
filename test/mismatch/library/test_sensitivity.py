# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Test the record of the decisions that another constant would change."""

from __future__ import annotations

from functools import partial

from adk_ros.mismatch.library.sensitivity import (
    Decisions,
    decided,
    recorded_decisions,
)


def _lies_between(statistic: float, low: float, high: float) -> bool:
    return low < statistic < high


def test_counts_the_decisions_that_half_and_double_change() -> None:
    with recorded_decisions() as record:
        for statistic in (3.0, 7.0, 30.0):
            assert decided(partial(_lies_between, statistic), LOW=4.0, HIGH=20.0) == (
                statistic == 7.0
            )
    # Half of LOW admits 3, twice LOW refuses 7; twice HIGH admits 30.
    assert record == {"LOW": Decisions(3, 1, 1), "HIGH": Decisions(3, 0, 1)}


def test_records_nothing_outside_of_the_context() -> None:
    with recorded_decisions() as record:
        pass
    decided(partial(_lies_between, 3.0), LOW=4.0, HIGH=20.0)
    assert record == {}
