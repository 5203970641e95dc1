# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled solver and its sums against numpy."""

import numpy as np
import pytest
from helpers.model import Array
from hypothesis import given, settings
from hypothesis import strategies as st

from adk_ros.model.adaptation.least_squares import cholesky_solve, rank_one


@settings(max_examples=40)
@given(st.integers(1, 24), st.integers(1, 20), st.integers(0, 999), st.floats(0.0, 6.0))
def test_cholesky_solve(n: int, m: int, seed: int, spread: float) -> None:
    random = np.random.default_rng(seed)
    turn = np.linalg.qr(random.normal(size=(n, n)))[0]
    matrix = turn @ np.diag(10.0 ** random.uniform(0.0, spread, n)) @ turn.T
    matrix = 0.5 * (matrix + matrix.T)
    right = random.normal(size=(n, m))
    solution = right.copy()
    smallest = cholesky_solve(matrix.copy(), solution)
    truth = np.linalg.solve(matrix, right)
    np.testing.assert_allclose(solution, truth, rtol=1e-8, atol=1e-10 * np.abs(truth).max())
    assert smallest == pytest.approx((np.diag(np.linalg.cholesky(matrix)) ** 2).min(), rel=1e-6)


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.diag([1.0, -1.0, 1.0]), np.ones((3, 3)), np.full((3, 3), np.nan)],
    ids=["zero", "indefinite", "singular", "nan"],
)
def test_cholesky_solve_reports_indefinite_matrices(matrix: Array) -> None:
    assert not cholesky_solve(matrix.copy(), np.ones((3, 2))) > 0.0


def test_rank_one_update_and_downdate_cancel() -> None:
    random = np.random.default_rng(0)
    gram, cross = np.zeros((6, 6)), np.zeros((6, 4))
    phis, ys = random.normal(size=(50, 6)), random.normal(size=(50, 4))
    for phi, y in zip(phis, ys, strict=True):
        rank_one(gram, cross, phi, y, 1.0)
    np.testing.assert_allclose(gram, phis.T @ phis)
    np.testing.assert_allclose(cross, phis.T @ ys)
    for phi, y in zip(phis, ys, strict=True):
        rank_one(gram, cross, phi, y, -1.0)
    assert np.abs(gram).max() < 1e-12
    assert np.abs(cross).max() < 1e-12
