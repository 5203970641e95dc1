# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The restricted likelihood of a fleet as a function of the deviations of one effect.

The variance components of every candidate maximise it, so it is compiled: all variables are
eliminated by one Cholesky factorisation per car, and one of what is common to all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.numba_cache import strict_kernel

MIN_INFORMATION = 1e-9
"""Added to the information on a size: one that nothing informs about is zero, and uncertain."""


@dataclass(frozen=True)
class Profile:
    """
    Logarithm of the restricted likelihood by the components of one active effect.

    All else is eliminated or summed per car once: a deviation between recordings is an update of
    rank one per recording. `informations` (c, n, n), `scores` (c, n); `rows` (r, n), `own` (r,)
    and `score` (r,): the effect's row, diagonal and score in each recording, of car `car` (r,).
    The first variables are those of a car, with `deviations` (k,), the effect's at `position`;
    then come `weak` ones, of variance one, and the sizes of the terms.
    """

    informations: FloatArray
    scores: FloatArray
    rows: FloatArray
    own: FloatArray
    score: FloatArray
    car: IntArray
    deviations: FloatArray
    position: int
    weak: int
    constant: float

    def restricted(self, tau: float, kappa: float) -> float:
        """
        Return the logarithm of REML at deviations between recordings and between cars.

        :raises numpy.linalg.LinAlgError: an information is not positive definite.
        """
        factor = tau**2 / (1.0 + tau**2 * self.own)
        deviations = self.deviations.copy()
        deviations[self.position] = kappa
        found = _eliminated(
            self.informations,
            self.scores,
            self.rows,
            self.score,
            factor,
            self.car,
            deviations,
            self.weak,
        )
        if not np.isfinite(found):
            raise np.linalg.LinAlgError("an information of the fleet is not positive definite")
        total = self.constant + 0.5 * float(factor @ self.score**2)
        return total - 0.5 * float(np.log1p(tau**2 * self.own).sum()) + found


@strict_kernel
def _eliminate(h: FloatArray, g: FloatArray, first: int, last: int) -> float:
    """
    Integrate over variables `first` to `last` of a quadratic; return the logarithm.

    `h` (n, n), of which the lower triangle is used, and `g` (n,) are changed in place.
    """
    total = 0.0
    n = g.shape[0]
    for p in range(first, last):
        if not h[p, p] > 0.0:
            return np.nan
        root = np.sqrt(h[p, p])
        q = g[p] / root
        total += 0.5 * q * q - np.log(root)
        for i in range(p + 1, n):
            h[i, p] /= root
        for i in range(p + 1, n):
            across = h[i, p]
            g[i] -= across * q
            for j in range(p + 1, i + 1):
                h[i, j] -= across * h[j, p]
    return total


@strict_kernel
def _eliminated(
    informations: FloatArray,
    scores: FloatArray,
    rows: FloatArray,
    score: FloatArray,
    factor: FloatArray,
    car: IntArray,
    deviations: FloatArray,
    weak: int,
) -> float:
    """Return the logarithm with all variables eliminated, arrays as in `Profile`."""
    cars, n = scores.shape
    k = deviations.shape[0]
    common, right = np.zeros((n - k, n - k)), np.zeros(n - k)
    h, g = np.empty((n, n)), np.empty(n)
    total = 0.0
    for c in range(cars):
        h[:] = informations[c]
        g[:] = scores[c]
        for r in range(car.shape[0]):
            if car[r] == c:
                for i in range(n):
                    weighted = factor[r] * rows[r, i]
                    g[i] -= weighted * score[r]
                    for j in range(i + 1):
                        h[i, j] -= weighted * rows[r, j]
        for i in range(k):
            g[i] *= deviations[i]
            for j in range(i + 1):
                h[i, j] *= deviations[i] * deviations[j]
            h[i, i] += 1.0
        for i in range(k, n):
            for j in range(k):
                h[i, j] *= deviations[j]
        total += _eliminate(h, g, 0, k)
        for i in range(n - k):
            right[i] += g[k + i]
            for j in range(i + 1):
                common[i, j] += h[k + i, k + j]
    for i in range(n - k):
        common[i, i] += 1.0 if i < weak else MIN_INFORMATION
    return total + _eliminate(common, right, 0, n - k)
