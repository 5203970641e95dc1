# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Least squares without lifting: the linear baseline of the Koopman model.

    x_(k+1) = x_k + s (theta phi_k),   phi_k = [x_k; u_k; 1]

in scaled units, where s is the standard deviation of the change of x per tick. The form of the
default predictor without features, past samples and disturbance. Offline, or adapted each tick by
the same windowed ridge solver.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.bench.paper.last_readings import predict_from_new_readings
from adk_ros.errors import DataError
from adk_ros.model.adaptation.online_methods import OnlineSettings, WindowedRidge
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.signals.channels import Record

_MAX_PAIR = 1e3
"""Largest scaled entry of a training pair: a larger one is a fault, and its rounding error would
remain in the Gram matrix of the window."""


@dataclass(frozen=True)
class LeastSquares:
    """
    Affine least squares of the scaled increment, `theta` (3, 6), rolled out by iteration.

    With `online` the matrix is adapted with all pairs up to a row; no pair spans a gap in the
    grid.
    """

    scaling: Scaling
    theta: FloatArray
    online: OnlineSettings | None = None
    name: str = "least squares"

    @staticmethod
    def fit(
        records: Sequence[Record], online: OnlineSettings | None = None, name: str = ""
    ) -> LeastSquares:
        """
        Fit to all pairs of successive learnable samples.

        :raises DataError: fewer than ten of them.
        """
        x, change, u = [], [], []
        for record in records:
            rows = np.flatnonzero(pairs(record))
            x.append(record.x[rows])
            u.append(record.u[rows])
            change.append(record.x[rows + 1] - record.x[rows])
        now, command, step = (
            np.concatenate([np.zeros((0, w)), *part]) for w, part in ((3, x), (2, u), (3, change))
        )
        if now.shape[0] < 10:
            raise DataError(
                f"least squares needs at least ten pairs of samples and the records have "
                f"{now.shape[0]}: use longer recordings"
            )
        scaling = Scaling.standard(now, command, step)
        phi = _phi(scaling, now, command)
        y = step / (scaling.x_scale * scaling.step_scale)
        theta = np.linalg.lstsq(phi, y, rcond=None)[0].T
        given = name or ("least squares" if online is None else "adapted least squares")
        return LeastSquares(scaling, np.ascontiguousarray(theta), online, given)

    def matrices(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return A (3, 3), B (3, 2), c (3,) of x_(k+1) = A x_k + B u_k + c, SI, not adapted."""
        s = self.scaling
        gain = (s.x_scale * s.step_scale)[:, None] * self.theta
        a = np.eye(3) + gain[:, :3] / s.x_scale
        b = gain[:, 3:5] / s.u_scale
        c = gain[:, 5] - gain[:, :3] @ (s.x_mean / s.x_scale) - b @ s.u_mean
        return a, b, c

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`."""
        if self.online is None:
            theta = np.broadcast_to(self.theta, (rows.shape[0], *self.theta.shape))
        else:
            theta = self._adapted(record, rows, self.online)
        unit = self.scaling.x_scale * self.scaling.step_scale

        def predict(of: IntArray, starts: IntArray, steps: int) -> FloatArray:
            out = np.empty((starts.shape[0], steps, 3))
            x, matrices = record.x[starts], theta[of]
            for step in range(steps):
                phi = _phi(self.scaling, x, record.u[starts + step])
                x = x + unit * np.einsum("nij,nj->ni", matrices, phi)
                out[:, step] = x
            return out

        # A diverging rollout is scored as such and needs no warning.
        with np.errstate(over="ignore", invalid="ignore"):
            return predict_from_new_readings(record, rows, ahead, predict)

    def _adapted(self, record: Record, rows: IntArray, settings: OnlineSettings) -> FloatArray:
        """Return the adapted theta at each row, (n, 3, 6)."""
        solver = WindowedRidge(self.theta, settings, has_constant=True)
        kept = np.empty((rows.shape[0], *self.theta.shape))
        last = int(rows[-1]) if rows.size else 0
        phi = _phi(self.scaling, record.x[: last + 1], record.u[: last + 1])
        change = np.diff(record.x[: last + 1], axis=0)
        y = change / (self.scaling.x_scale * self.scaling.step_scale)
        known = pairs(record)[:last] & (np.abs(y) < _MAX_PAIR).all(axis=1)
        known &= (np.abs(phi[:-1]) < _MAX_PAIR).all(axis=1)
        begin = 0
        for i, row in enumerate(rows.tolist()):
            # The pair (k, k + 1) is known at k + 1.
            for k in (begin + np.flatnonzero(known[begin:row])).tolist():
                solver.update(phi[k], y[k])
            begin = row
            kept[i] = solver.theta
        return kept


def pairs(record: Record) -> BoolArray:
    """Return a mask (len - 1,): rows k and k + 1 form a learnable pair."""
    good = record.learnable & np.isfinite(record.x).all(axis=1)
    both = good[:-1] & good[1:] & (record.episode[1:] == record.episode[:-1])
    return np.asarray(both & np.isfinite(record.u[:-1]).all(axis=1))


def _phi(scaling: Scaling, x: FloatArray, u: FloatArray) -> FloatArray:
    ones = np.ones((x.shape[0], 1))
    return np.hstack([scaling.scale_x(x), scaling.scale_u(u), ones])
