# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Lag between two signals, with a delay told from a first-order low-pass filter.

With u the earlier and w the later signal, u(t) = k (w(t + d) + T dw/dt(t + d)) + b: a delay d
and a low-pass of time constant T, inverted, so that the filter is exact. At low frequency
both delay by d + T; they differ at higher frequency. The later signal, which a filter has made
smooth, is differentiated; the noise of the other is only in the target and biases nothing.

Of the forms "none", "delay", "filter" (d = 0) and "both", one is chosen by the share of the
variance of u that it leaves unexplained; where delay and filter do about equally well, only the
sum is stated ("lag").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.calibration.criteria import (
    FORM_CONFIDENCE,
    LAG_STEP_S,
    MAX_LAG_S,
    MIN_FORM_GAIN,
    MIN_LAG_CORRELATION,
    MIN_LAG_S,
    MIN_SPARE_BLOCKS,
    PERIOD_S,
)
from adk_ros.calibration.grid import shifted, smooth
from adk_ros.calibration.regression import Estimate, block_rows, draws, inflation
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

WINDOW_S = 0.7
"""s: second smoothing of both signals, for the derivative; a cubic over it passes 1.5 Hz."""


@dataclass(frozen=True)
class Lag:
    """
    How much later y is than x.

    `form`: "none", "delay", "filter", "both", or "lag" where delay and filter are not told apart.
    `total`: sum of delay and time constant. `delay`, `filter`: each of them under the form, zero
    where it has none; a negative filter means that x is filtered. `correlation` of the
    aligned signals.
    """

    form: str
    total: Estimate
    delay: Estimate
    filter: Estimate
    correlation: float


def lag_between(x: FloatArray, y: FloatArray, weights: FloatArray) -> Lag | None:
    """
    Return the lag of y (n,) behind x (n,), both smoothed alike; None if it is not decided.

    It is not with too few blocks, with a correlation below `MIN_LAG_CORRELATION`, or where the
    best delay is at the end of the search range. A negative lag: x is the later one.
    """
    x, y = smooth(x, WINDOW_S), smooth(y, WINDOW_S)
    rows = block_rows()
    edges = np.arange(0, x.shape[0], rows, dtype=np.int64)
    used = np.add.reduceat(weights, edges) > 0.0
    blocks = int(used.sum())
    if blocks < 3 + MIN_SPARE_BLOCKS:
        return None
    coarse = np.arange(-MAX_LAG_S, MAX_LAG_S + 0.5 * LAG_STEP_S, LAG_STEP_S)
    left = [_Family.of(x, y, lag, weights, edges).unexplained(False)[0][0] for lag in coarse]
    nearest = int(np.argmin(left))
    if not 0 < nearest < coarse.size - 1:
        return None
    sign = 1.0 if coarse[nearest] > -0.5 * LAG_STEP_S else -1.0
    early, late = (x, y) if sign > 0.0 else (y, x)
    # Beyond the best delay on both sides, for its minimum; zero is on the grid.
    last = int(np.ceil(abs(coarse[nearest]) / LAG_STEP_S)) + 3
    lags: FloatArray = LAG_STEP_S * np.arange(-3.0, last)
    zero = 3
    counts = np.vstack([np.ones(blocks), draws(blocks)])
    fits = [_Family.of(early, late, lag, weights, edges, used) for lag in lags]
    delayed = np.column_stack([fit.unexplained(False, counts)[0] for fit in fits])
    filtered, taus = (
        np.column_stack(each)
        for each in zip(*(fit.unexplained(True, counts) for fit in fits), strict=True)
    )
    delay, delay_left = _minimum(lags, delayed)
    both, both_left = _minimum(lags, filtered)
    tau = np.array([np.interp(at, lags, row) for at, row in zip(both, taus, strict=True)])
    best = float(min(both_left[0], delay_left[0], filtered[0, zero]))
    if best > 1.0 - MIN_LAG_CORRELATION**2:
        return None
    nothing = np.zeros_like(delay)
    form, delay_of, tau_of, share = _form(
        (delayed[:, zero], nothing, nothing),
        (delay_left, delay, nothing),
        (filtered[:, zero], nothing, taus[:, zero]),
        (both_left, both, tau),
    )
    spread = inflation(float(blocks), 3)
    seconds = float(np.count_nonzero(weights)) * PERIOD_S

    def estimate(values: FloatArray) -> Estimate:
        signed = sign * values
        resampled = signed[0] + spread * (signed[1:] - signed[0])
        return Estimate.of(float(signed[0]), resampled, seconds)

    total = delay if form in ("none", "lag") else delay_of + tau_of
    correlation = float(np.sqrt(max(1.0 - share[0], 0.0)))
    return Lag(form, estimate(total), estimate(delay_of), estimate(tau_of), correlation)


@dataclass(frozen=True)
class _Family:
    """Sums of products by block (b, 4, 4) of w(t + d), its derivative, 1 and u(t)."""

    sums: FloatArray

    @classmethod
    def of(
        cls,
        early: FloatArray,
        late: FloatArray,
        lag: float,
        weights: FloatArray,
        edges: IntArray,
        used: BoolArray | None = None,
    ) -> _Family:
        ahead = shifted(late, -lag)
        table = np.column_stack([ahead, np.gradient(ahead, PERIOD_S), np.ones_like(ahead), early])
        products = np.einsum("ni,nj->nij", table * weights[:, None], table)
        sums = np.add.reduceat(products, edges)
        return cls(sums if used is None else sums[used])

    def unexplained(
        self, with_filter: bool, counts: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return the unexplained share of the variance of u (r,), and T (r,)."""
        given = np.ones((1, self.sums.shape[0])) if counts is None else counts
        sums = np.tensordot(given, self.sums, 1)
        columns = [0, 1, 2] if with_filter else [0, 2]
        matrix = sums[:, columns][:, :, columns]
        vector = sums[:, columns, 3]
        solved = (np.linalg.pinv(matrix, rcond=1e-12) @ vector[..., None])[..., 0]
        error = sums[:, 3, 3] - np.einsum("ri,ri->r", solved, vector)
        power = sums[:, 3, 3] - sums[:, 2, 3] ** 2 / np.maximum(sums[:, 2, 2], 1e-9)
        share = np.clip(error / np.maximum(power, 1e-12), 0.0, 1.0)
        gain = np.where(np.abs(solved[:, 0]) > 1e-9, solved[:, 0], 1.0)
        tau = solved[:, 1] / gain if with_filter else np.zeros_like(gain)
        return share, tau


_Fit = tuple[FloatArray, FloatArray, FloatArray]
"""Unexplained share of the variance, delay and time constant, each (r + 1,)."""


def _form(
    none: _Fit, delay: _Fit, low_pass: _Fit, both: _Fit
) -> tuple[str, FloatArray, FloatArray, FloatArray]:
    """Return the form with its delay, time constant and unexplained share of the variance."""
    nothing = np.zeros_like(none[0])
    lag = delay[1]
    if lag[0] < MIN_LAG_S or none[0][0] <= (1.0 + MIN_FORM_GAIN) * delay[0][0]:
        return "none", nothing, nothing, none[0]
    # Noise of the later signal looks like a delay with a negative time constant.
    is_one_sided = both[1][0] >= MIN_LAG_S and both[2][0] >= MIN_LAG_S
    single = np.minimum(delay[0], low_pass[0])
    gained = float((both[0][1:] * (1.0 + MIN_FORM_GAIN) < single[1:]).mean())
    if is_one_sided and gained >= FORM_CONFIDENCE:
        return "both", both[1], both[2], both[0]
    better = float((delay[0][1:] < low_pass[0][1:]).mean())
    margin = abs(np.log(max(delay[0][0], 1e-12) / max(low_pass[0][0], 1e-12)))
    if margin < MIN_FORM_GAIN or not (
        better >= FORM_CONFIDENCE or better <= 1.0 - FORM_CONFIDENCE
    ):
        return "lag", lag, nothing, delay[0]
    if delay[0][0] <= low_pass[0][0]:
        return "delay", lag, nothing, delay[0]
    return "filter", nothing, low_pass[2], low_pass[0]


def _minimum(at: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return place and value (r,) of the minimum of each row (r, n), by a parabola through 3."""
    r = np.arange(values.shape[0])
    i = np.clip(np.argmin(values, axis=1), 1, at.size - 2)
    x0, x1, x2 = at[i - 1], at[i], at[i + 1]
    f0, f1, f2 = values[r, i - 1], values[r, i], values[r, i + 1]
    d1, d2 = (f1 - f0) / (x1 - x0), (f2 - f1) / (x2 - x1)
    curvature = (d2 - d1) / (x2 - x0)
    safe = np.where(curvature > 0.0, curvature, 1.0)
    place = np.where(curvature > 0.0, 0.5 * (x0 + x1) - 0.5 * d1 / safe, x1)
    place = np.clip(place, x0, x2)
    value = f0 + d1 * (place - x0) + curvature * (place - x0) * (place - x1)
    return place, np.where(curvature > 0.0, np.maximum(value, 0.0), f1)
