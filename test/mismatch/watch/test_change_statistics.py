# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The likelihood ratio of a change on blocks with known columns, and fits of what changed."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from adk_ros.mismatch.watch.block import Block
from adk_ros.mismatch.watch.candidate_columns import ColumnLayout
from adk_ros.mismatch.watch.change_statistics import ChangeStatistics
from adk_ros.mismatch.watch.settings import REFERENCE_BLOCKS, RING_BLOCKS
from adk_ros.numerics.arrays import FloatArray

NUISANCES = np.full(3, 0.4)
LAYOUT = ColumnLayout.of(NUISANCES)
ROWS, BLOCKS = 300, 50
PAYLOAD = next(c for c in LAYOUT.candidates if c.effect.name == "payload")


def blocks(
    changed_from: int = BLOCKS,
    size: float = 0.0,
    before: float = 0.0,
    shared: float = 0.0,
    seed: int = 0,
) -> list[Block]:
    """Blocks in which the payload is `before`, then `before` + `size` thresholds."""
    random = np.random.default_rng(seed)
    out = []
    for b in range(BLOCKS):
        columns = random.normal(0.0, 0.3, (ROWS, LAYOUT.count))
        payload = columns[:, PAYLOAD.columns[0]]
        value = before + (size if b >= changed_from else 0.0)
        residuals = random.normal(size=ROWS) - value * payload + columns[:, 1]
        residuals += shared * random.normal() * payload
        road = random.normal(0.0, 1.0, (ROWS, 2))
        residuals += road @ random.normal(size=2)
        likelihood = cast("Any", None)
        out.append(
            Block(5.0 * b, 5.0 * b + 5.0, likelihood, np.arange(ROWS), residuals, columns, road)
        )
    return out


def statistics_of(many: list[Block]) -> ChangeStatistics:
    statistics = ChangeStatistics(LAYOUT)
    for block in many:
        statistics.add(block)
    return statistics


def test_no_change_has_a_small_statistic() -> None:
    best = statistics_of(blocks()).changes()[0]
    assert best.statistic < 25.0


def test_a_change_is_found_with_effect_onset_and_size() -> None:
    statistics = statistics_of(blocks(changed_from=40, size=1.5))
    best = statistics.changes()[0]
    assert best.candidate is PAYLOAD
    assert statistics.blocks[best.onset_block].block.begin_s == pytest.approx(200.0, abs=5.0)
    assert -best.size[0] == pytest.approx(-1.5, abs=0.2)
    assert best.statistic > 100.0


def test_what_the_car_had_before_is_no_change() -> None:
    best = statistics_of(blocks(before=4.0)).changes()[0]
    assert best.statistic < 25.0
    both = statistics_of(blocks(changed_from=40, size=1.5, before=4.0)).changes()[0]
    assert both.candidate is PAYLOAD
    assert both.size[0] == pytest.approx(1.5, abs=0.2)


def test_errors_that_are_common_to_a_block_widen_the_spread() -> None:
    quiet, loud = blocks(), blocks(shared=0.6)
    column = PAYLOAD.columns[0]
    assert statistics_of(quiet).spread(RING_BLOCKS)[column] < 2.0
    statistics = statistics_of(loud)
    assert statistics.spread(RING_BLOCKS)[column] > 4.0
    own = next(x for x in statistics.changes() if x.candidate is PAYLOAD)
    assert own.statistic < 0.4 * own.gain


def test_nothing_is_decided_before_the_reference_is_learnt() -> None:
    statistics = ChangeStatistics(LAYOUT)
    for block in blocks(changed_from=10, size=5.0)[: REFERENCE_BLOCKS + 1]:
        statistics.add(block)
        assert statistics.changes() == []
    assert not statistics.is_ready


def test_memory_is_bounded() -> None:
    statistics = statistics_of(blocks())
    assert len(statistics.blocks) == RING_BLOCKS
    assert statistics.old.shape == (1 + LAYOUT.count, 1 + LAYOUT.count)


def test_products_are_those_of_a_random_road() -> None:
    block = blocks()[0]
    covariance = np.eye(ROWS) + block.road @ block.road.T
    every = np.column_stack([block.residuals, block.columns[:, :4]])
    expected = every.T @ np.linalg.solve(covariance, every)
    ones: FloatArray = np.ones(ROWS)
    np.testing.assert_allclose(every.T @ block.weighed(ones, every), expected, rtol=1e-9)
