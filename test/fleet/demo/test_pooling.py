# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""scripts/fleet_pooling.py: the totals."""

from __future__ import annotations

from fleet_pooling import totals

from adk_ros.fleet.demo.truth_comparison import TruthComparison


def test_the_totals() -> None:
    found, tied = (TruthComparison((), 1, 1, ties, 0, 1, 1 - ties) for ties in (0, 1))
    wrong, missed = (TruthComparison((), 1, 0, 0, false, 0, 0) for false in (2, 0))
    assert totals([found, tied, wrong, missed], [1.0 - 1e-9, 1.5, 0.5, 0.5]) == {
        "effects named": "2 of 4 (50 %), 1 in a tie",
        "those of a threshold and more": "2 of 2 (100 %), 1 in a tie",
        "with a false claim": "1 of 4 (25 %)",
        "sizes in their 90 % interval": "1 of 2 (50 %)",
    }
    nothing = TruthComparison((), 0, 0, 0, 0, 0, 0)
    assert totals([nothing], [0.0])["effects named"] == "-"
