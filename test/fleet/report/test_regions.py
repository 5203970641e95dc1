# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Regions of the map of a fleet."""

from __future__ import annotations

import time

import numpy as np
import pytest

from adk_ros.fleet.report.fleet_figures import _REGION_M, _regions
from adk_ros.numerics.arrays import FloatArray


def regions_by_pairs(centres: FloatArray) -> list[list[int]]:
    """Return the connected regions by the distances of all pairs."""
    near = np.abs(centres[:, None] - centres[None]).max(axis=2) < _REGION_M
    while not np.array_equal(further := near @ near, near):
        near = further
    return sorted(np.flatnonzero(row).tolist() for row in np.unique(near, axis=0))


@pytest.mark.parametrize("seed", range(5))
def test_regions_are_those_of_all_pairs(seed: int) -> None:
    random = np.random.default_rng(seed)
    centres = 60.0 * (np.round(random.uniform(-150.0, 150.0, (150, 2))) + 0.5)
    found = _regions(centres)
    assert sorted(rows.tolist() for rows in found) == regions_by_pairs(centres)
    assert 1 < len(found) < 150
    middles = [centres[rows, 0].mean() for rows in found]
    assert middles == sorted(middles)
    assert _regions(centres[:0]) == []


def test_a_long_road_takes_time_in_proportion() -> None:
    started = time.process_time()
    (region,) = _regions(np.stack([60.0 * np.arange(20_000), np.zeros(20_000)], axis=1))
    assert len(region) == 20_000
    assert time.process_time() - started < 2.0
