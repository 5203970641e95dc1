# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reliability of stated confidences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import beta

from adk_ros.bench.mismatch.reliability import (
    ScoredClaim,
    brier_score,
    reliability_markdown,
    reliability_table,
    share_interval,
)


def claims(confidence: float, right: int, wrong: int) -> list[ScoredClaim]:
    return [ScoredClaim("a", confidence, i < right) for i in range(right + wrong)]


def test_bins_hold_their_lower_limit_and_one_the_last() -> None:
    table = reliability_table(
        [*claims(0.9, 1, 0), *claims(1.0, 1, 0), *claims(0.5, 0, 1), *claims(0.0, 0, 1)]
    )
    assert [b.claims for b in table] == [1, 1, 0, 2]
    assert math.isnan(table[2].right)
    assert table[3].said == pytest.approx(0.95)


def test_calibrated_claims_have_the_variance_as_their_score() -> None:
    rng = np.random.default_rng(1)
    many = [ScoredClaim("a", 0.8, bool(rng.random() < 0.8)) for _ in range(4000)]
    assert brier_score(many) == pytest.approx(0.16, abs=0.01)
    (b,) = [b for b in reliability_table(many) if b.claims]
    assert b.interval[0] < 0.8 < b.interval[1]
    assert brier_score(claims(1.0, 3, 0)) == 0.0
    assert math.isnan(brier_score([]))


def test_the_interval_is_that_of_clopper_and_pearson() -> None:
    low, high = share_interval(18, 20)
    assert low == pytest.approx(beta.ppf(0.025, 18, 3))
    assert high == pytest.approx(beta.ppf(0.975, 19, 2))


def test_the_table_says_that_there_is_no_claim() -> None:
    assert "Brier score of 0 claims: no claim" in reliability_markdown([])
