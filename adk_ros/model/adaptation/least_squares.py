# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Windowed and recursive least squares, compiled: what the online methods do each tick.

Arrays are updated in place, in float64; nothing is allocated.
"""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.numba_cache import strict_kernel


@strict_kernel
def cholesky_solve(matrix, right):  # type: ignore[no-untyped-def]
    """
    Solve matrix @ X = right in place (X in `right`), `matrix` (n, n) overwritten by its factor.

    Return the smallest pivot; not positive means that the matrix is not positive definite.
    """
    n, m = right.shape
    smallest = np.inf
    for j in range(n):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        smallest = min(smallest, pivot)
        if not pivot > 0.0:
            return pivot
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
def rank_one(gram, cross, phi, y, sign):  # type: ignore[no-untyped-def]
    """gram += sign phi phi', cross += sign phi y'; (n, n) and (n, m)."""
    n = phi.shape[0]
    m = y.shape[0]
    for i in range(n):
        value = sign * phi[i]
        for j in range(n):
            gram[i, j] += value * phi[j]
        for j in range(m):
            cross[i, j] += value * y[j]


@strict_kernel
def windowed_update(  # type: ignore[no-untyped-def]
    phi, y, theta0, theta, phis, ys, gram, cross, ridge, slot, full, work, right
):
    """
    Slide the window by one pair and solve it anew.

    theta = argmin sum |y_i - theta phi_i|^2 + ridge |theta - theta0|^2 over the window. The window
    holds what is left of y after the offline model, so that theta0 is the zero of the problem.
    Return False if there is no finite solution.
    """
    n_out, n_phi = theta.shape
    if full:
        rank_one(gram, cross, phis[slot], ys[slot], -1.0)
    phis[slot, :] = phi
    for c in range(n_out):
        value = y[c]
        for j in range(n_phi):
            value -= theta0[c, j] * phi[j]
        ys[slot, c] = value
    rank_one(gram, cross, phis[slot], ys[slot], 1.0)
    work[:] = gram
    for j in range(n_phi):
        work[j, j] += ridge
    right[:] = cross
    if not cholesky_solve(work, right) > 0.0:
        return False
    total = 0.0
    for c in range(n_out):
        for j in range(n_phi):
            theta[c, j] = theta0[c, j] + right[j, c]
            total += abs(theta[c, j])
    return np.isfinite(total)


@strict_kernel
def rls_update(phi, y, theta, covariance, forgetting, gain):  # type: ignore[no-untyped-def]
    """
    Recursive least squares with forgetting factor (1: none); the textbook recursion.

    gain = P phi / (f + phi' P phi); theta += (y - theta phi) gain'; P = (P - gain phi' P) / f.
    Return False if P or theta is no longer finite.
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
