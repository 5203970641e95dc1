# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tests at the cells of a map, against errors of the surrogate with heavy and light tails."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.fleet.inference.cell_tests import CellTest, p_value, tail_of
from adk_ros.numerics.arrays import FloatArray

CELLS = 300


def sizes_of(deviations: FloatArray) -> list[CellTest]:
    return [CellTest(2.0 * float(z), 4.0, 40.0) for z in deviations]


@pytest.mark.parametrize("seed", range(5))
def test_the_tail_is_that_of_the_sizes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    heavy = tail_of(sizes_of(rng.standard_t(3.0, CELLS)))
    light = tail_of(sizes_of(rng.standard_normal(CELLS)))
    assert 1.8 < heavy < 6.0
    assert light > 10.0


def test_places_among_the_cells_do_not_make_the_tail_heavier() -> None:
    z = np.random.default_rng(1).standard_normal(CELLS)
    with_places = np.concatenate([z, np.full(8, 30.0)])
    assert tail_of(sizes_of(with_places)) > 8.0


def test_few_cells_are_no_evidence_of_a_normal_distribution() -> None:
    z = np.random.default_rng(1).standard_normal(CELLS)
    assert tail_of([]) == pytest.approx(10.0, rel=0.01), "the mode of the prior"
    assert tail_of(sizes_of(z[:10])) < tail_of(sizes_of(z))


def test_a_size_that_few_others_exceed_is_significant_only_with_a_light_tail() -> None:
    assert p_value(CellTest(12.0, 4.0, 40.0)) < 1e-5
    assert p_value(CellTest(12.0, 4.0, 4.0)) > 1e-3
