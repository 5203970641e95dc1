# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maxima of quadratics within bounds."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.bounded_quadratic import bounded_maxima


def _problems(seed: int, count: int, size: int) -> tuple[FloatArray, FloatArray]:
    """Return informations and scores whose free maxima lie far beyond bounds of three."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, size, size)) * 10.0 ** rng.uniform(-2, 2, (count, 1, size))
    informations = np.einsum("rji,rjk->rik", rows, rows) + np.eye(size)
    at = 4.0 * rng.normal(size=(count, size))
    scores = np.einsum("rij,rj->ri", informations, at) + 30.0 * rng.normal(size=(count, size))
    return informations, scores


def _value(information: FloatArray, score: FloatArray, x: FloatArray) -> float:
    return float(score @ x - 0.5 * x @ information @ x)


@pytest.mark.parametrize("seed", range(3))
def test_the_maximum_is_that_of_bounded_least_squares(seed: int) -> None:
    informations, scores = _problems(seed, 40, 12)
    bounds = np.full(12, 3.0)
    found = bounded_maxima(informations, scores, bounds)
    assert np.all(np.abs(found) <= bounds)
    assert np.any(np.abs(found) == bounds)
    for h, s, x in zip(informations, scores, found, strict=True):
        root = np.linalg.cholesky(h)
        right = np.linalg.solve(root, s)
        reference = lsq_linear(root.T, right, (-bounds, bounds), method="bvls").x
        best = _value(h, s, reference)
        assert _value(h, s, x) == pytest.approx(best, rel=1e-9)


def test_a_maximum_within_the_bounds_is_the_free_one() -> None:
    informations, scores = _problems(5, 10, 6)
    found = bounded_maxima(informations, scores, np.full(6, 1e9))
    free = np.linalg.solve(informations, scores[:, :, None])[:, :, 0]
    assert found == pytest.approx(free)


def test_single_exchanges_end_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    informations, scores = _problems(7, 40, 12)
    bounds = np.full(12, 0.5)
    expected = bounded_maxima(informations, scores, bounds)
    monkeypatch.setattr("adk_ros.numerics.bounded_quadratic._BLOCK_STEPS", 0)
    assert bounded_maxima(informations, scores, bounds) == pytest.approx(expected)
