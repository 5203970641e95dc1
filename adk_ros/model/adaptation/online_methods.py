# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Online methods that adapt the lifted linear model y = theta phi, one class each.

phi = [z_k; u_k; 1] (the 1 only in the affine form); y = z_(k+1), or its scaled increment in the
residual form. `METHODS` maps names to methods.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.least_squares import WindowArrays, rls_update, windowed_update
from adk_ros.numerics.array_table import ArrayTable
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class OnlineSettings:
    """
    Parameters of the online methods; each method reads those it needs.

    `window`: samples in the window (windowed, swls). `ridge`: weight of the offline model, in
    units of the Gram matrix of scaled regressors, so about equivalent samples (windowed).
    `forgetting`: factor per tick (ffrls). `initial_covariance`: diagonal of P_0 (rls, ffrls).
    :raises UsageError: the method is unknown or a value is out of range.
    """

    method: str = "windowed"
    window: int = 400
    ridge: float = 100.0
    forgetting: float = 0.98
    initial_covariance: float = 1.0

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UsageError(
                f"online method '{self.method}' is unknown: choose one of {', '.join(METHODS)}"
            )
        if not 2 <= self.window <= 100_000:
            raise UsageError(f"window is {self.window} samples: choose 2 to 100000")
        if not _MIN_RIDGE <= self.ridge <= 1e12:
            raise UsageError(
                f"ridge is {self.ridge:g}: choose 0.001 to 1e12 (below 0.001 the solution drifts)"
            )
        if not 0.5 < self.forgetting <= 1.0:
            raise UsageError(f"forgetting is {self.forgetting:g}: choose above 0.5 and at most 1")
        if not 0.0 < self.initial_covariance <= 1e9:
            raise UsageError(
                f"initial_covariance is {self.initial_covariance:g}: choose above 0, at most 1e9"
            )


class OnlineMethod(Protocol):
    """
    Interface of an online method.

    `failures` counts resets after a solution that is not finite.
    """

    theta: FloatArray
    failures: int

    def update(self, phi: FloatArray, y: FloatArray) -> None:
        """Learn one pair: phi (n_phi,), y (n_z,)."""

    def reset(self) -> None:
        """Return to the offline model."""

    def condition_number(self) -> float:
        """Return that of the matrix that is inverted; NaN if there is none."""


class FixedModel:
    """No adaptation: the offline model."""

    def __init__(self, theta0: FloatArray, settings: OnlineSettings) -> None:
        self.theta = theta0.copy()
        self.failures = 0

    def update(self, phi: FloatArray, y: FloatArray) -> None:
        """Ignore the pair."""

    def reset(self) -> None:
        """Do nothing: theta does not change."""

    def condition_number(self) -> float:
        """Return NaN: no matrix is inverted."""
        return float("nan")


class RecursiveLeastSquares:
    """
    RLS (forgetting 1) and FFRLS, the paper's baselines.

    With forgetting, P grows without bound along directions without excitation and overflows within
    some ten thousand ticks. Theta and P are then reset to the offline model and P_0, and the reset
    is counted in `failures`.
    """

    def __init__(self, theta0: FloatArray, settings: OnlineSettings, forgetting: float) -> None:
        self._theta0 = theta0.copy()
        self._initial = settings.initial_covariance
        self._forgetting = forgetting
        self._gain = np.zeros(theta0.shape[1])
        self.failures = 0
        self.reset()

    def update(self, phi: FloatArray, y: FloatArray) -> None:
        """Learn one pair with `rls_update`."""
        finite = rls_update(phi, y, self.theta, self._covariance, self._forgetting, self._gain)
        if not finite:
            self.failures += 1
            self.reset()

    def reset(self) -> None:
        """Return to the offline model and P_0."""
        self.theta = self._theta0.copy()
        self._covariance = np.eye(self.theta.shape[1]) * self._initial

    def condition_number(self) -> float:
        """Return that of P."""
        return _condition(self._covariance)


RCOND = 1e-10
"""
Eigenvalues below this share of the largest count as zero: a direction without excitation. Float64
sums of squares are accurate to about 1e-14; smaller shares would let the update follow rounding
noise.
"""
_MAX_THETA = 1e6
"""
Largest entry of theta in scaled units before `PaperSWLS` is reset; far above any useful model.
"""


class PaperSWLS:
    """
    The paper's Algorithm 1 (SWLS), with the transpose that eq. (33) lacks.

    P = [X X']^+ over the last M regressors (eqs. 30 to 32), theta += (y - theta phi) phi' P. This
    is not windowed least squares: old samples leave P but not theta. The Gram matrix is usually
    singular, so its pseudo-inverse is taken, as in eq. (10).
    """

    def __init__(self, theta0: FloatArray, settings: OnlineSettings, rcond: float = RCOND) -> None:
        self._theta0 = theta0.copy()
        self._rcond = rcond
        self.theta = theta0.copy()
        self._phis = np.zeros((settings.window, theta0.shape[1]))
        self._count = 0
        self.failures = 0

    def update(self, phi: FloatArray, y: FloatArray) -> None:
        """Learn one pair, eqs. (30) to (33)."""
        window = self._phis.shape[0]
        self._phis[self._count % window] = phi
        self._count += 1
        known = self._phis[: min(self._count, window)]
        try:
            direction = np.linalg.pinv(known.T @ known, rcond=self._rcond, hermitian=True) @ phi
        except np.linalg.LinAlgError:
            direction = np.full(phi.shape[0], np.nan)
        theta = self.theta + np.outer(y - self.theta @ phi, direction)
        if not np.isfinite(theta).all() or np.abs(theta).max() > _MAX_THETA:
            self.failures += 1
            self.reset()
            return
        self.theta = theta

    def reset(self) -> None:
        """Return to the offline model and an empty window."""
        self.theta = self._theta0.copy()
        self._count = 0

    def condition_number(self) -> float:
        """Return that of the window's Gram matrix."""
        known = self._phis[: min(self._count, self._phis.shape[0])]
        return _condition(known.T @ known)


_LATERAL = (1, 2)
"""Outputs of v_y and yaw rate."""
_OFFSET_RIDGE_SHARE = 0.01
"""
Ridge of the constant regressor of the lateral outputs, as a share of that of the others.

A cross slope is a constant that no offline model knows. With the ridge of the others it is
explained by all regressors that are not zero in the mean, and the dynamics are wrong
(`scripts/lateral_constant.py` prints the errors). A constant is usually not penalised (T. Hastie,
R. Tibshirani, J. Friedman, The Elements of Statistical Learning, 2009, section 3.4.1); that it has
this share, and not a tenth of it or more, is by choice. Not for v_x: a grade changes within the
window, and the disturbances follow it.
"""
_MIN_RIDGE = 1e-3
"""Below it the solution drifts."""


class WindowedRidge:
    """
    Windowed least squares with a ridge penalty towards the offline model: the default.

    Each tick adds one outer product to the window's Gram matrix and removes one, in float64, and
    solves with a new Cholesky factorisation. Only sums are recursive, so errors do not accumulate.

    :param has_constant: whether the last regressor is 1; its ridge is then nearly 0 where
        `_LATERAL` says.
    """

    def __init__(
        self, theta0: FloatArray, settings: OnlineSettings, has_constant: bool = False
    ) -> None:
        n_out, n_phi = theta0.shape
        offset_ridge = np.full(n_out, settings.ridge)
        if has_constant:
            share = max(_OFFSET_RIDGE_SHARE * settings.ridge, _MIN_RIDGE)
            offset_ridge[list(_LATERAL)] = share
        self._window = WindowArrays(
            theta=np.zeros((n_out, n_phi)),
            theta0=np.ascontiguousarray(theta0, dtype=np.float64),
            ridge=np.array([settings.ridge]),
            n_pairs=np.zeros(1, dtype=np.int64),
            phis=np.zeros((settings.window, n_phi)),
            ys=np.zeros((settings.window, n_out)),
            gram=np.zeros((n_phi, n_phi)),
            cross=np.zeros((n_phi, n_out)),
            work=np.zeros((n_phi, n_phi)),
            right=np.zeros((n_phi, n_out + 1)),
            offset_ridge=offset_ridge,
        )
        self._table = ArrayTable(*self._window)
        self.rows = self._table.rows
        """All arrays, as a table for kernels."""
        self.theta = self._window.theta
        self.failures = 0
        self.reset()

    def update(self, phi: FloatArray, y: FloatArray) -> None:
        """Slide the window by one pair and solve."""
        if not windowed_update(phi, y, self.rows):
            self.start_again()

    def start_again(self) -> None:
        """Count a failure, and reset."""
        self.failures += 1
        self.reset()

    def reset(self) -> None:
        """Return to the offline model and an empty window."""
        window = self._window
        window.theta[:] = window.theta0
        window.gram[:] = 0.0
        window.cross[:] = 0.0
        window.n_pairs[0] = 0

    @property
    def ridge(self) -> float:
        """Ridge of all coefficients but those of `offset_ridge`."""
        return float(self._window.ridge[0])

    @property
    def offset_ridge(self) -> FloatArray:
        """Ridge of the coefficient of the last regressor, by output (m,)."""
        return np.array(self._window.offset_ridge)

    @property
    def n_pairs(self) -> int:
        """Number of pairs learned since the last reset."""
        return int(self._window.n_pairs[0])

    def condition_number(self) -> float:
        """Return that of the Gram matrix with the common ridge, which is factorised."""
        gram = self._window.gram
        return _condition(gram + self._window.ridge * np.eye(gram.shape[0]))

    def batch_solution(self) -> FloatArray:
        """Return theta (m, n) solved from the stored pairs at once, to check the recursion."""
        window = self._window
        pairs = min(self.n_pairs, len(window.phis))
        phi, y = window.phis[:pairs], window.ys[:pairs]
        n_phi = phi.shape[1]
        solution = np.empty_like(window.theta0)
        for of_constant in np.unique(window.offset_ridge):
            outputs = window.offset_ridge == of_constant
            weight = np.sqrt(np.append(np.full(n_phi - 1, window.ridge[0]), of_constant))
            stacked = np.vstack([phi, np.diag(weight)])
            target = np.vstack([y[:, outputs], np.zeros((n_phi, int(outputs.sum())))])
            solution[outputs] = np.linalg.lstsq(stacked, target, rcond=None)[0].T
        return np.asarray(window.theta0 + solution)


def _condition(matrix: FloatArray) -> float:
    if not np.isfinite(matrix).all():
        return float("inf")
    values = np.linalg.eigvalsh(matrix)
    return float(values[-1] / values[0]) if values[0] > 0.0 else float("inf")


def _fixed(theta0: FloatArray, settings: OnlineSettings, _: bool) -> OnlineMethod:
    return FixedModel(theta0, settings)


def _rls(theta0: FloatArray, settings: OnlineSettings, _: bool) -> OnlineMethod:
    return RecursiveLeastSquares(theta0, settings, forgetting=1.0)


def _ffrls(theta0: FloatArray, settings: OnlineSettings, _: bool) -> OnlineMethod:
    return RecursiveLeastSquares(theta0, settings, forgetting=settings.forgetting)


def _swls(theta0: FloatArray, settings: OnlineSettings, _: bool) -> OnlineMethod:
    return PaperSWLS(theta0, settings)


METHODS: dict[str, Callable[[FloatArray, OnlineSettings, bool], OnlineMethod]] = {
    "constant": _fixed,
    "rls": _rls,
    "ffrls": _ffrls,
    "swls": _swls,
    "windowed": WindowedRidge,
}
"""Method of (theta0, settings, has_constant) by name; the last: whether a regressor is 1."""
