# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled updates of windowed and recursive least squares.

Arrays are float64 and updated in place; nothing is allocated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.numerics.array_table import floats_1, floats_2, integers_1
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.numba_cache import strict_kernel


class WindowArrays(NamedTuple):
    """
    State of windowed least squares with n regressors and m outputs, window of w pairs.

    `theta` (m, n): the solution; `theta0` (m, n): offline model; `ridge` (1,); `n_pairs` (1,):
    pairs so far; `phis` (w, n), `ys` (w, m): those in the window, a ring buffer; `gram` (n, n),
    `cross` (n, m): their sums of products; `work` (n, n), `right` (n, m + 1): scratch.
    `offset_ridge` (m,): ridge of the last regressor, by output, at most `ridge`.
    """

    theta: FloatArray
    theta0: FloatArray
    ridge: FloatArray
    n_pairs: NDArray[np.int64]
    phis: FloatArray
    ys: FloatArray
    gram: FloatArray
    cross: FloatArray
    work: FloatArray
    right: FloatArray
    offset_ridge: FloatArray


@strict_kernel
def window_arrays(rows: IntArray) -> WindowArrays:
    """Return the structure that an `ArrayTable` of its fields passes to kernels."""
    return WindowArrays(
        floats_2(rows, 0),
        floats_2(rows, 1),
        floats_1(rows, 2),
        integers_1(rows, 3),
        floats_2(rows, 4),
        floats_2(rows, 5),
        floats_2(rows, 6),
        floats_2(rows, 7),
        floats_2(rows, 8),
        floats_2(rows, 9),
        floats_1(rows, 10),
    )


@strict_kernel
def cholesky_solve(matrix: FloatArray, right: FloatArray) -> float:
    """
    Solve matrix @ X = right in place of `right`; `matrix` (n, n) is overwritten by its factor.

    Return the smallest pivot. If it is not positive, the matrix is not positive definite and
    `right` is not solved for.
    """
    n, m = right.shape
    smallest = np.inf
    for j in range(n):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        smallest = min(smallest, pivot)
        if not pivot > 0.0:
            return float(pivot)
        pivot = np.sqrt(pivot)
        matrix[j, j] = pivot
        for i in range(j + 1, n):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = value / pivot
    for j in range(n):
        for k in range(j):
            factor = matrix[j, k]
            for c in range(m):
                right[j, c] -= factor * right[k, c]
        for c in range(m):
            right[j, c] /= matrix[j, j]
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            factor = matrix[k, j]
            for c in range(m):
                right[j, c] -= factor * right[k, c]
        for c in range(m):
            right[j, c] /= matrix[j, j]
    return smallest


@strict_kernel
def rank_one(
    gram: FloatArray, cross: FloatArray, phi: FloatArray, y: FloatArray, sign: float
) -> None:
    """gram (n, n) += sign phi phi', cross (n, m) += sign phi y'."""
    n = phi.shape[0]
    m = y.shape[0]
    for i in range(n):
        value = sign * phi[i]
        for j in range(n):
            gram[i, j] += value * phi[j]
        for j in range(m):
            cross[i, j] += value * y[j]


@strict_kernel
def windowed_update(phi: FloatArray, y: FloatArray, rows: IntArray) -> bool:
    """
    Replace the oldest pair of the window, or add one, and solve for theta.

    theta = argmin sum |y_i - theta phi_i|^2 + ridge |theta - theta0|^2 over the window. The window
    stores y - theta0 phi, so that theta - theta0 is solved for. `rows`: see `window_arrays`.
    Return False if there is no finite solution.

    The last regressor may have a smaller ridge. With G the Gram matrix and its common ridge, e the
    unit vector of that regressor and d the difference of the ridges (Sherman and Morrison, 1950),

        (G - d e e')^-1 b = x + d w x_n / (1 - d w_n),  x = G^-1 b, w = G^-1 e
    """
    window = window_arrays(rows)
    theta, theta0, phis, ys = window.theta, window.theta0, window.phis, window.ys
    work, right = window.work, window.right
    size = phis.shape[0]
    slot, full = window.n_pairs[0] % size, window.n_pairs[0] >= size
    window.n_pairs[0] += 1
    n_out, n_phi = theta.shape
    if full:
        rank_one(window.gram, window.cross, phis[slot], ys[slot], -1.0)
    phis[slot, :] = phi
    for c in range(n_out):
        value = y[c]
        for j in range(n_phi):
            value -= theta0[c, j] * phi[j]
        ys[slot, c] = value
    rank_one(window.gram, window.cross, phis[slot], ys[slot], 1.0)
    work[:] = window.gram
    for j in range(n_phi):
        work[j, j] += window.ridge[0]
    right[:, :n_out] = window.cross
    right[:, n_out] = 0.0
    right[n_phi - 1, n_out] = 1.0
    if not cholesky_solve(work, right) > 0.0:
        return False
    total = 0.0
    for c in range(n_out):
        freed = window.ridge[0] - window.offset_ridge[c]
        if freed > 0.0:
            left = 1.0 - freed * right[n_phi - 1, n_out]
            if not left > 0.0:
                return False
            freed *= right[n_phi - 1, c] / left
            for j in range(n_phi):
                right[j, c] += freed * right[j, n_out]
        for j in range(n_phi):
            theta[c, j] = theta0[c, j] + right[j, c]
            total += abs(theta[c, j])
    return bool(np.isfinite(total))


@strict_kernel
def rls_update(
    phi: FloatArray,
    y: FloatArray,
    theta: FloatArray,
    covariance: FloatArray,
    forgetting: float,
    gain: FloatArray,
) -> bool:
    """
    Recursive least squares with a forgetting factor f (1: none), the textbook recursion.

    gain = P phi / (f + phi' P phi); theta += (y - theta phi) gain'; P = (P - gain phi' P) / f.
    `gain` (n_phi,) is scratch. Return False if P or theta is no longer finite.
    """
    n_out, n_phi = theta.shape
    total = forgetting
    for i in range(n_phi):
        value = 0.0
        for j in range(n_phi):
            value += covariance[i, j] * phi[j]
        gain[i] = value
        total += phi[i] * value
    if not (np.isfinite(total) and total > 0.0):
        return False
    for i in range(n_phi):
        for j in range(n_phi):
            covariance[i, j] = (covariance[i, j] - gain[i] * gain[j] / total) / forgetting
    for c in range(n_out):
        error = y[c]
        for j in range(n_phi):
            error -= theta[c, j] * phi[j]
        for j in range(n_phi):
            theta[c, j] += error * gain[j] / total
            if not np.isfinite(theta[c, j]):
                return False
    return True
