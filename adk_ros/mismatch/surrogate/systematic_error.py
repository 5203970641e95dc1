# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The surrogate's own error as a function of the driven state, learned on the simulation.

What the surrogate gets wrong about the simulator it also gets wrong about the car, in the same
manoeuvres. Per channel, the residuals on the simulation are regressed on the driven state, its
transients and the signs of its signals (ridge regression). The fit, evaluated along a recording,
is subtracted from its residuals: a control variate (B. L. Nelson, "Control variate remedies",
Operations Research 38 (1990) 974). The error that remains is that on stretches of the simulation
left out of the fit.

The signals of a car relate to each other otherwise than the simulation's: that is what is looked
for. Errors in the columns of a regression, of a share q of their size, equal a ridge penalty of
q^2; without one, the fit rests on small differences of proportional signals. Each column is
limited to its range in the simulation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.surrogate.feature_terms import feature_signals
from adk_ros.mismatch.surrogate.lap import find_lap
from adk_ros.mismatch.surrogate.residuals import BIN_S, ResidualProblem
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.numerics.filters import low_pass

SIGNALS = ("v_x", "v_y", "yaw_rate", "a_x", "a_y", "torque", "delta")
"""Signals of the driven state, as in `library.features`."""
_TRANSIENTS_S = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Time constants of the transients: from a tyre's to that of the whitening filters (1.2 s)."""
_SIGN_WIDTH = 0.2
"""
Size at which a sign is about 0.8, over the signal's RMS. Play, dry friction and a tyre's shift
with camber depend on a sign; a step would make noise of a signal near zero. What
remains is measured on stretches left out, so that another width costs accuracy and no claim.
"""
_COLUMN_ERROR = 0.1
"""
Share of a column by which a car may differ from its simulation: the size of usual effects (those
of the benchmark at strength 1 change a gain by 3 to 20 %).
"""
_FOLDS = 5
_STRETCH_S = 5.0
"""Duration of a stretch that is left out as a whole, about that of a bend."""
_MIN_STRETCH_S = 2.4
"""On a short lap: twice the memory of the whitening filters, 1.2 s, which join its ends."""
_MIN_STRETCHES = 2 * _FOLDS


@dataclass(frozen=True)
class SystematicError:
    """
    Error of a surrogate by driven state.

    `spread` (7,): RMS of `SIGNALS` in the simulation; `low`, `high` (k,): range of each column
    there; `coefficients` (6, k) by channel; `remaining` (6, bins): the residuals on the simulation
    less the fit, as large as on stretches left out.
    """

    spread: FloatArray
    low: FloatArray
    high: FloatArray
    coefficients: FloatArray
    remaining: FloatArray

    def along(self, problem: ResidualProblem, out: FloatArray) -> FloatArray:
        """Return the error (6, bins) along a recording; `out`: the surrogate's run along it."""
        columns = np.clip(_columns(_signals(problem, out), self.spread), self.low, self.high)
        # A run that diverges leaves the residuals as they are.
        return np.asarray(np.nan_to_num(self.coefficients @ columns.T))


def learn_systematic_error(
    problem: ResidualProblem, out: FloatArray, residuals: FloatArray, settling_bins: int
) -> SystematicError | None:
    """
    Learn the error of a surrogate from its run `out` along the simulation and its `residuals`.

    `residuals` (6, bins); the first `settling_bins` do not count. None where the simulation is too
    short to leave stretches out, or where no channel's error depends on the driven state.
    """
    signals = _signals(problem, out)
    spread = np.maximum(np.sqrt((signals**2).mean(axis=0)), 1e-12)
    columns = _columns(signals, spread)[settling_bins:]
    fold = _folds(problem)[settling_bins:]
    if fold.max(initial=-1) < 0:
        return None
    scale = np.maximum(np.sqrt((columns**2).mean(axis=0)), 1e-12)
    remaining = residuals[:, settling_bins:].copy()
    coefficients = np.zeros((residuals.shape[0], columns.shape[1]))
    ridge = _Ridge.of(columns / scale, remaining.T, fold)
    left_out = ridge.left_out()
    for channel, size in enumerate(ridge.solve(np.ones(_FOLDS, dtype=bool)).T):
        before = float(np.sum(remaining[channel] ** 2))
        if left_out[channel] >= before:
            continue
        coefficients[channel] = size / scale
        left = remaining[channel] - columns @ coefficients[channel]
        # The fit itself is closer than on what it has not seen.
        inflated = left_out[channel] / max(float(np.sum(left**2)), 1e-300)
        remaining[channel] = left * np.sqrt(max(inflated, 1.0))
    if not coefficients.any():
        return None
    return SystematicError(
        spread, columns.min(axis=0), columns.max(axis=0), coefficients, remaining
    )


@dataclass(frozen=True)
class _Ridge:
    """
    Ridge regression of several targets on common columns of unit mean square, by fold.

    `normals` (f, k, k), `rights` (f, k, c), `squares` (f, c), `counts` (f,) of the rows of a fold.
    """

    normals: FloatArray
    rights: FloatArray
    squares: FloatArray
    counts: FloatArray

    @classmethod
    def of(cls, columns: FloatArray, targets: FloatArray, fold: IntArray) -> _Ridge:
        parts: list[BoolArray] = [np.asarray(fold == i) for i in range(_FOLDS)]
        return cls(
            np.array([columns[at].T @ columns[at] for at in parts]),
            np.array([columns[at].T @ targets[at] for at in parts]),
            np.array([(targets[at] ** 2).sum(axis=0) for at in parts]),
            np.array([float(at.sum()) for at in parts]),
        )

    def left_out(self) -> FloatArray:
        """Return the sum of squared errors (c,) of each fold under the fit to the others."""
        left = self.squares.sum(axis=0)
        for i in range(_FOLDS):
            size = self.solve(np.arange(_FOLDS) != i)
            left += np.einsum("kc,kl,lc->c", size, self.normals[i], size)
            left -= 2.0 * (size * self.rights[i]).sum(axis=0)
        return np.asarray(left)

    def solve(self, kept: BoolArray) -> FloatArray:
        """Return the coefficients (k, c) of the fit to the folds `kept`."""
        normal = self.normals[kept].sum(axis=0)
        penalty = _COLUMN_ERROR**2 * self.counts[kept].sum()
        normal[np.diag_indices_from(normal)] += penalty
        return np.asarray(np.linalg.solve(normal, self.rights[kept].sum(axis=0)))


def _signals(problem: ResidualProblem, out: FloatArray) -> FloatArray:
    """Return the means of `SIGNALS` (bins, 7) in each bin of a recording."""
    signals = feature_signals(problem, out)
    return np.column_stack([problem.binned(signals[name]) for name in SIGNALS])


def _columns(signals: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the columns (bins, k): a constant, the state, its transients and its signs."""
    transients = [
        x - low_pass(x, BIN_S, tau)
        for x in np.ascontiguousarray(signals.T)
        for tau in _TRANSIENTS_S
    ]
    signs = np.tanh(signals / (_SIGN_WIDTH * spread))
    return np.column_stack([np.ones(signals.shape[0]), signals, *transients, signs])


def _folds(problem: ResidualProblem) -> IntArray:
    """
    Return the fold (bins,) of each bin; -1 throughout where there are too few stretches.

    Stretches are places along the lap where a lap is repeated, so that no fold knows a place from
    another lap, and parts of the time elsewhere.
    """
    lap = find_lap(problem)
    elapsed = problem.bin_s - problem.start_s
    if lap is None:
        stretch = (elapsed / _STRETCH_S).astype(np.int64)
    else:
        speed = np.maximum(np.mean(np.abs(problem.smoothed_odometry[:, 0])), 1.0)
        lap_s = lap.length / speed
        count = max(int(lap_s / _STRETCH_S), min(int(lap_s / _MIN_STRETCH_S), _MIN_STRETCHES), 1)
        at = np.interp(problem.bin_s, problem.middle_s, lap.unwrapped) % lap.length
        stretch = np.minimum((at / lap.length * count).astype(np.int64), count - 1)
    if stretch.max() + 1 < _MIN_STRETCHES:
        return np.full(problem.bins, -1)
    order = np.random.default_rng(0).permutation(stretch.max() + 1)
    return np.asarray(order[stretch] % _FOLDS)
