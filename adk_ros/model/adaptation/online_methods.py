# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The ways to adapt the lifted linear model y = theta phi online, one class each.

phi = [z_k; u_k; 1] (the 1 only in the affine form), y = z_(k+1), or its scaled increment in the
residual form. `METHODS` names them; a new one is a class like the others and a row there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.least_squares import rls_update, windowed_update
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class OnlineSettings:
    """
    Parameters of the online methods; each method reads the ones it knows.

    `window`: samples in the window. `ridge`: pull to the offline model, in units of the Gram of
    scaled regressors, so about "this many samples' worth" along a direction of unit size.
    `forgetting`: factor per tick of ffrls. `initial_covariance`: diagonal P_0 of rls and ffrls.
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
        if not 1e-3 <= self.ridge <= 1e12:
            raise UsageError(
                f"ridge is {self.ridge:g}: choose 0.001 to 1e12 (below that the solution drifts)"
            )
        if not 0.5 < self.forgetting <= 1.0:
            raise UsageError(f"forgetting is {self.forgetting:g}: choose above 0.5 and at most 1")
        if not 0.0 < self.initial_covariance <= 1e9:
            raise UsageError(
                f"initial_covariance is {self.initial_covariance:g}: choose above 0, at most 1e9"
            )


class OnlineMethod(Protocol):
    """What the predictor needs of an online method."""

    theta: FloatArray
    failures: int

    def update(self, phi: FloatArray, y: FloatArray) -> None:
        """Learn one pair, phi (n_phi,), y (n_z,)."""

    def reset(self) -> None:
        """Return to the offline model."""

    def condition_number(self) -> float:
        """Of the matrix that is solved with; NaN where there is none."""


class FixedModel:
    """The offline model as it is."""

    def __init__(self, theta0: FloatArray, settings: OnlineSettings) -> None:
        self.theta = theta0.copy()
        self.failures = 0

    def update(self, phi: FloatArray, y: FloatArray) -> None:
        """Learn nothing."""

    def reset(self) -> None:
        """Nothing to return from."""

    def condition_number(self) -> float:
        """NaN: nothing is solved."""
        return float("nan")


class RecursiveLeastSquares:
    """
    RLS (forgetting 1) and FFRLS as the paper compares them; theta and P are kept finite.

    With forgetting, P grows without bound along directions that the drive does not excite and is
    NaN within some ten thousand ticks. It is then set back to P_0 and counted in `failures`.
    """

    def __init__(self, theta0: FloatArray, settings: OnlineSettings, forgetting: float) -> None:
        self._theta0 = theta0.copy()
        self._initial = settings.initial_covariance
        self._forgetting = forgetting
        self._gain = np.zeros(theta0.shape[1])
        self.failures = 0
        self.reset()

    def update(self, phi: FloatArray, y: FloatArray) -> None:
        """Learn one pair by the recursion of `rls_update`."""
        finite = rls_update(phi, y, self.theta, self._covariance, self._forgetting, self._gain)
        if not finite:
            self.failures += 1
            self.reset()

    def reset(self) -> None:
        """Return to the offline model and P_0."""
        self.theta = self._theta0.copy()
        self._covariance = np.eye(self.theta.shape[1]) * self._initial

    def condition_number(self) -> float:
        """Of P."""
        return _condition(self._covariance)


_RCOND = 1e-10
"""
Of the largest eigenvalue, below which a direction counts as not excited. Float64 sums of squares
are good to about 1e-14; what is kept near that is noise that the update then follows.
"""


class PaperSWLS:
    """
    The paper's Algorithm 1 (SWLS), faithful but for the transpose that eq. (33) lacks.

    P = [X X']^+ over the last M regressors (eqs. 30 to 32), theta += (y - theta phi) phi' P. It is
    no windowed least squares: old samples leave P but not theta. The Gram is usually singular, so
    its pseudo-inverse is taken, as eq. (10) does.
    """

    def __init__(self, theta0: FloatArray, settings: OnlineSettings) -> None:
        self._theta0 = theta0.copy()
        self.theta = theta0.copy()
        self._phis = np.zeros((settings.window, theta0.shape[1]))
        self._count = 0
        self.failures = 0

    def update(self, phi: FloatArray, y: FloatArray) -> None:
        """Learn one pair by eqs. (30) to (33)."""
        window = self._phis.shape[0]
        self._phis[self._count % window] = phi
        self._count += 1
        known = self._phis[: min(self._count, window)]
        try:
            direction = np.linalg.pinv(known.T @ known, rcond=_RCOND, hermitian=True) @ phi
        except np.linalg.LinAlgError:
            direction = np.full(phi.shape[0], np.nan)
        theta = self.theta + np.outer(y - self.theta @ phi, direction)
        if not np.isfinite(theta).all() or np.abs(theta).max() > 1e6:
            self.failures += 1
            self.reset()
            return
        self.theta = theta

    def reset(self) -> None:
        """Return to the offline model and an empty window."""
        self.theta = self._theta0.copy()
        self._count = 0

    def condition_number(self) -> float:
        """Of the window's Gram."""
        known = self._phis[: min(self._count, self._phis.shape[0])]
        return _condition(known.T @ known)


class WindowedRidge:
    """
    Exact windowed least squares with ridge to the offline model: the default.

    Each tick the Gram of the window gains one outer product and loses one, in float64, and is
    solved by a fresh Cholesky factorisation: nothing is recursive but sums, so nothing drifts.
    """

    def __init__(self, theta0: FloatArray, settings: OnlineSettings) -> None:
        n_out, n_phi = theta0.shape
        self._theta0 = np.ascontiguousarray(theta0, dtype=np.float64)
        self._ridge = settings.ridge
        self._phis = np.zeros((settings.window, n_phi))
        self._ys = np.zeros((settings.window, n_out))
        self._work = np.zeros((n_phi, n_phi))
        self._right = np.zeros((n_phi, n_out))
        self.failures = 0
        self.reset()

    def update(self, phi: FloatArray, y: FloatArray) -> None:
        """Slide the window by one pair and solve."""
        window = self._phis.shape[0]
        solved = windowed_update(
            phi,
            y,
            self._theta0,
            self.theta,
            self._phis,
            self._ys,
            self._gram,
            self._cross,
            self._ridge,
            self._count % window,
            self._count >= window,
            self._work,
            self._right,
        )
        self._count += 1
        if not solved:
            self.failures += 1
            self.reset()

    def reset(self) -> None:
        """Return to the offline model and an empty window."""
        n_out, n_phi = self._theta0.shape
        self.theta = self._theta0.copy()
        self._gram = np.zeros((n_phi, n_phi))
        self._cross = np.zeros((n_phi, n_out))
        self._count = 0

    def condition_number(self) -> float:
        """Of the Gram with its ridge: what is really solved with."""
        return _condition(self._gram + self._ridge * np.eye(self._gram.shape[0]))

    def batch_solution(self) -> FloatArray:
        """The window's problem solved from its stored pairs, for checking; shape of theta."""
        rows = min(self._count, self._phis.shape[0])
        phi, y = self._phis[:rows], self._ys[:rows]
        n_phi = phi.shape[1]
        stacked = np.vstack([phi, np.sqrt(self._ridge) * np.eye(n_phi)])
        target = np.vstack([y, np.zeros((n_phi, y.shape[1]))])
        solution: FloatArray = np.linalg.lstsq(stacked, target, rcond=None)[0]
        return np.asarray(self._theta0 + solution.T)


def _condition(matrix: FloatArray) -> float:
    if not np.isfinite(matrix).all():
        return float("inf")
    values = np.linalg.eigvalsh(matrix)
    return float(values[-1] / values[0]) if values[0] > 0.0 else float("inf")


def _rls(theta0: FloatArray, settings: OnlineSettings) -> OnlineMethod:
    return RecursiveLeastSquares(theta0, settings, forgetting=1.0)


def _ffrls(theta0: FloatArray, settings: OnlineSettings) -> OnlineMethod:
    return RecursiveLeastSquares(theta0, settings, forgetting=settings.forgetting)


METHODS: dict[str, Callable[[FloatArray, OnlineSettings], OnlineMethod]] = {
    "constant": FixedModel,
    "rls": _rls,
    "ffrls": _ffrls,
    "swls": PaperSWLS,
    "windowed": WindowedRidge,
}
