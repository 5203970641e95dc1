# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Weighted linear regression with one delay, and its covariance by a block bootstrap.

The delay is found by Gauss-Newton steps: a signal that is delayed a little more changes by its
derivative, which is one more column. Blocks are longer than the memory of the residuals, so that
the scatter of resampled estimates includes their correlation (H. R. Künsch, Annals of Statistics
17 (1989) 1217).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import t

from adk_ros.mismatch.recording.common_driving import BLOCK_ROWS, PERIOD_S
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import QUANTILE_90

MAX_DELAY_S = 0.6
"""Largest delay that is searched for, s: that of a steering delay in the catalogue."""
_ITERATIONS = 12
_LARGEST_STEP_S, _TOLERANCE_S = 0.1, 1e-4
_RESAMPLES = 300
_MIN_SPARE_BLOCKS = 3
"""Blocks beyond the number of coefficients: with fewer, the scatter has no finite variance."""


@dataclass(frozen=True)
class Regression:
    """Coefficients (k,), the delay last if there is one, and resampled ones (r, k)."""

    values: FloatArray
    resampled: FloatArray


Target = Callable[[float], FloatArray]
"""Delay in s -> target (n,) of a regression."""


def regress(columns: FloatArray, target: FloatArray, weights: FloatArray) -> Regression | None:
    """Return the regression of `target` (n,) on `columns` (n, k); None with too few data."""
    blocks = _Blocks.of(columns, columns, target, weights)
    return None if blocks is None else blocks.regression()


def regress_delayed(
    columns: FloatArray,
    target: Target,
    weights: FloatArray,
    instruments: FloatArray | None = None,
) -> Regression | None:
    """
    Return the regression of a delayed signal on `columns` (n, k), with the delay that fits best.

    Noise of the columns biases least squares towards zero. `instruments` (n, k) are the same
    quantities from other sensors, whose noise is independent (instrumental variables). None with
    too few data, or if no delay within +-`MAX_DELAY_S` fits best.
    """
    delay = 0.0
    given = columns if instruments is None else instruments
    for _ in range(_ITERATIONS):
        delayed = target(delay)
        # A signal that is delayed by d more changes by -d times its derivative.
        slope = np.gradient(delayed, PERIOD_S)
        blocks = _Blocks.of(
            np.column_stack([columns, slope]), np.column_stack([given, slope]), delayed, weights
        )
        if blocks is None:
            return None
        step = float(blocks.solved()[-1])
        if abs(step) < _TOLERANCE_S:
            found = blocks.regression()
            shift = np.zeros(found.values.shape[0])
            shift[-1] = delay
            return Regression(found.values + shift, found.resampled + shift)
        delay += float(np.clip(step, -_LARGEST_STEP_S, _LARGEST_STEP_S))
        if abs(delay) > MAX_DELAY_S:
            break
    return None


@dataclass(frozen=True)
class _Blocks:
    """
    Normal equations by block: instruments times columns (b, k, k), times target (b, k).

    `count`: effective number of blocks.
    """

    matrices: FloatArray
    vectors: FloatArray
    count: float

    @classmethod
    def of(
        cls,
        columns: FloatArray,
        instruments: FloatArray,
        target: FloatArray,
        weights: FloatArray,
    ) -> _Blocks | None:
        edges = np.arange(0, target.shape[0], BLOCK_ROWS)
        weighted = instruments * weights[:, None]
        sums = np.add.reduceat(weights, edges)
        used = sums > 0.0
        count = float(sums.sum() ** 2 / max((sums**2).sum(), 1e-300))
        if count < columns.shape[1] + _MIN_SPARE_BLOCKS:
            return None
        products = np.einsum("ni,nj->nij", weighted, columns)
        matrices = np.add.reduceat(products, edges)[used]
        vectors = np.add.reduceat(weighted * target[:, None], edges)[used]
        return cls(matrices, vectors, count)

    def solved(self, counts: FloatArray | None = None) -> FloatArray:
        """Return the coefficients (k,), or (r, k) with each block counted (r, b) times."""
        counts = np.ones(self.matrices.shape[0]) if counts is None else counts
        matrix = np.tensordot(counts, self.matrices, 1)
        vector = np.tensordot(counts, self.vectors, 1)
        scale = np.sqrt(np.maximum(np.abs(np.einsum("...ii->...i", matrix)), 1e-300))
        scaled = matrix / (scale[..., :, None] * scale[..., None, :])
        inverse = np.linalg.pinv(scaled, rcond=1e-10)
        return np.asarray((inverse @ (vector / scale)[..., None])[..., 0] / scale)

    def regression(self) -> Regression:
        """Return the coefficients, and resampled ones with the scatter of `count` blocks."""
        n, k = self.vectors.shape
        random = np.random.default_rng(0)
        counts = random.multinomial(n, np.full(n, 1.0 / n), _RESAMPLES).astype(np.float64)
        values = self.solved()
        # The residuals of a fit of k coefficients to few blocks are too small, and an interval
        # from few blocks is that of Student's t.
        spare = self.count - k
        inflation = np.sqrt(self.count / spare) * float(t.ppf(0.95, spare)) / QUANTILE_90
        return Regression(values, values + inflation * (self.solved(counts) - values))
