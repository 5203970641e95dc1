# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Weighted linear regression with instruments, and its intervals by a block bootstrap.

Noise of the columns biases least squares towards zero (errors in variables). `instruments` are
the same quantities from other sensors, whose noise is independent: the estimate solves
Z' W (y - X b) = 0 (L. Ljung, System Identification, 1999, section 7.6). Blocks of 5 s are drawn
with replacement, so that intervals include the correlation of the residuals in time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t

from adk_ros.calibration.criteria import BLOCK_S, MIN_SPARE_BLOCKS, PERIOD_S, RESAMPLES
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import QUANTILE_90


@dataclass(frozen=True)
class Estimate:
    """A value with its standard error and 90 % interval, from `seconds` of driving."""

    value: float
    standard_error: float
    low: float
    high: float
    seconds: float

    @classmethod
    def of(cls, value: float, resampled: FloatArray, seconds: float) -> Estimate:
        """Return the estimate with the scatter of resampled values (r,)."""
        spread = np.percentile(resampled - value, [5.0, 95.0])
        error = float((spread[1] - spread[0]) / (2.0 * QUANTILE_90))
        return cls(value, error, value + float(spread[0]), value + float(spread[1]), seconds)

    def shifted(self, by: float) -> Estimate:
        """Return the estimate of the value plus a constant."""
        return replace(self, value=self.value + by, low=self.low + by, high=self.high + by)

    def divided(self, by: float) -> Estimate:
        """Return the estimate of the value over a positive constant."""
        return Estimate(
            self.value / by, self.standard_error / by, self.low / by, self.high / by, self.seconds
        )


@dataclass(frozen=True)
class Regression:
    """Coefficients (k,), resampled ones (r, k), and the driving used, s."""

    values: FloatArray
    resampled: FloatArray
    seconds: float

    def estimate(self, i: int) -> Estimate:
        """Return coefficient `i` with its interval."""
        return Estimate.of(float(self.values[i]), self.resampled[:, i], self.seconds)


def block_rows(period_s: float = PERIOD_S, block_s: float = BLOCK_S) -> int:
    """Return the number of rows of a bootstrap block."""
    return max(1, round(block_s / period_s))


def draws(blocks: int) -> FloatArray:
    """Return how often each block is drawn (r, blocks), the same for equal `blocks`."""
    random = np.random.default_rng(0)
    counts = random.multinomial(blocks, np.full(blocks, 1.0 / blocks), RESAMPLES)
    return np.asarray(counts, dtype=np.float64)


def inflation(blocks: float, coefficients: int) -> float:
    """
    Return the factor on the scatter of resampled coefficients.

    The residuals of a fit of k coefficients to few blocks are too small, and an interval from few
    blocks is that of Student's t.
    """
    spare = blocks - coefficients
    return float(np.sqrt(blocks / spare) * t.ppf(0.95, spare) / QUANTILE_90)


def regress(
    columns: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    instruments: FloatArray | None = None,
    period_s: float = PERIOD_S,
    block_s: float = BLOCK_S,
) -> Regression | None:
    """
    Return the regression of `target` (n,) on `columns` (n, k), weighted by `weights` (n,).

    None with too few data. `instruments` (n, k): default the columns (least squares).
    """
    given = columns if instruments is None else instruments
    rows = block_rows(period_s, block_s)
    edges = np.arange(0, target.shape[0], rows)
    sums = np.add.reduceat(weights, edges)
    used = sums > 0.0
    count = float(sums.sum() ** 2 / max(float((sums**2).sum()), 1e-300))
    k = columns.shape[1]
    if count < k + MIN_SPARE_BLOCKS:
        return None
    weighted = given * weights[:, None]
    matrices = np.add.reduceat(np.einsum("ni,nj->nij", weighted, columns), edges)[used]
    vectors = np.add.reduceat(weighted * target[:, None], edges)[used]
    values = _solved(matrices, vectors, np.ones((1, matrices.shape[0])))[0]
    resampled = _solved(matrices, vectors, draws(matrices.shape[0]))
    resampled = values + inflation(count, k) * (resampled - values)
    return Regression(values, resampled, float(weights.sum()) * period_s)


def _solved(matrices: FloatArray, vectors: FloatArray, counts: FloatArray) -> FloatArray:
    """Return the coefficients (r, k) with each block counted (r, b) times."""
    matrix = np.tensordot(counts, matrices, 1)
    vector = np.tensordot(counts, vectors, 1)
    scale = np.sqrt(np.maximum(np.abs(np.einsum("...ii->...i", matrix)), 1e-300))
    scaled = matrix / (scale[..., :, None] * scale[..., None, :])
    inverse = np.linalg.pinv(scaled, rcond=1e-10)
    return np.asarray((inverse @ (vector / scale)[..., None])[..., 0] / scale)
