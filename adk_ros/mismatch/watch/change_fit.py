# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fit of one effect from an onset on, with everything that is static profiled out.

The residuals of the blocks after the onset are simulated anew with the effect, so that its
equation acts as it is and not as its linearisation. The static columns stay linear: the loss at
theta is

    sum_b r_b' M r_b - f' N^-1 f,   f = sum_b X_b' M r_b(theta),

which Gauss and Newton's method minimises in theta. No equation of an effect is exact: build
tolerances and sensor offsets may change a little at the onset as well (`settings.JUMP_SHARE`).
Otherwise the error of one equation would decide between two effects. All candidates are compared
under the same robust weights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.nuisances import N_FIXED_NUISANCES
from adk_ros.mismatch.library.criteria import PENALTY_PER_PARAMETER
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.state_index import N_CHANNELS
from adk_ros.mismatch.watch.block import Block, robust_weights
from adk_ros.mismatch.watch.change_statistics import ChangeStatistics
from adk_ros.mismatch.watch.settings import JUMP_SHARE, WARM_UP_S
from adk_ros.numerics.arrays import FloatArray, IntArray

_ITERATIONS = 5
_HALVINGS = 3
_BEFORE_ALL = Activation(onset_s=-1e9)
_CONVERGED = 0.5
"""Gain in loss of a step after which no further one is worth its time."""


@dataclass(frozen=True)
class FittedChange:
    """
    An effect fitted from an onset on.

    `loss`: of all blocks, the older ones excepted; `block_losses` (b,): of the blocks after the
    onset; `deviations` (k,) of theta.
    """

    active: ActiveEffect
    loss: float
    block_losses: FloatArray
    deviations: FloatArray

    @property
    def penalised_loss(self) -> float:
        """Loss with the penalty of each parameter."""
        return self.loss + PENALTY_PER_PARAMETER * len(self.active.theta)


class ChangeFit:
    """
    The data before and after an onset, for the fits of several effects.

    `onset_block`: index of the first changed block in the ring of `statistics`.
    """

    def __init__(self, statistics: ChangeStatistics, onset_block: int) -> None:
        layout = statistics.layout
        items = list(statistics.blocks)
        self.after: list[Block] = [item.block for item in items[onset_block:]]
        self._columns = np.concatenate([layout.static, layout.static[:N_FIXED_NUISANCES]])
        static = 1 + layout.static
        before = statistics.old + sum(
            (item.gram for item in items[:onset_block]), np.zeros_like(statistics.old)
        )
        normal = before[np.ix_(static, static)] + np.diag(layout.precision)
        fitted = -np.linalg.solve(normal, before[static, 0])
        own = [_loss_of(item.gram, static, fitted) for item in items[:onset_block]]
        # The tolerances may change with the effect: they do not act before it.
        count = static.size
        jumps = layout.precision[:N_FIXED_NUISANCES] / JUMP_SHARE**2
        self._normal_before = np.diag(np.concatenate([layout.precision, jumps]))
        self._normal_before[:count, :count] = normal
        self._right_before = np.zeros(self._columns.size)
        self._right_before[:count] = before[static, 0]
        self._coefficients = np.zeros(self._columns.size)
        self._coefficients[:count] = fitted
        rows = [item.block.rows.size for item in items[:onset_block]]
        self.reference_losses = np.array(own) / np.maximum(rows, 1)
        """Loss per residual of each block before the onset."""
        self._use([item.weights for item in items[onset_block:]])

    def _use(self, weights: list[FloatArray]) -> None:
        """Use robust weights, and the products of the static columns with them."""
        self._weights = weights
        self._normal = self._normal_before.copy()
        self._static: list[FloatArray] = []
        for block, weight in zip(self.after, weights, strict=True):
            columns = self._columns_of(block)
            seen = block.weighed(weight, columns)
            self._static.append(seen)
            self._normal += columns.T @ seen
        self._inverse = np.linalg.inv(self._normal)

    def _columns_of(self, block: Block) -> FloatArray:
        """Return the columns (m, s) of a block after the onset that are profiled out."""
        return block.columns[:, self._columns]

    @property
    def rows(self) -> FloatArray:
        """Residuals (b,) of each block after the onset."""
        return np.array([float(block.rows.size) for block in self.after])

    def surrogate_error(self) -> float:
        """Return the number of residuals that the model's own error accounts for."""
        total = 0.0
        for block in self.after:
            channel = block.rows // block.likelihood.problem.bins
            count = np.bincount(channel[channel < N_CHANNELS], minlength=N_CHANNELS)
            total += float(block.likelihood.surrogate_error_share @ count)
        return total

    def null_losses(self) -> FloatArray:
        """Return the losses (b,) of the blocks after the onset without a change."""
        return self._block_losses([block.residuals for block in self.after], self._coefficients)

    def null_channel_losses(self) -> FloatArray:
        """Return the mean square residual (6,) by channel after the onset, without a change."""
        total, count = np.zeros(N_CHANNELS), np.full(N_CHANNELS, 1e-9)
        for block in self.after:
            channel = block.rows // block.likelihood.problem.bins
            r = block.residuals + self._columns_of(block) @ self._coefficients
            kept = channel < N_CHANNELS
            total += np.bincount(channel[kept], r[kept] ** 2, N_CHANNELS)
            count += np.bincount(channel[kept], minlength=N_CHANNELS)
        return np.asarray(total / count)

    def residuals(
        self, active: ActiveEffect, throughout: list[FloatArray] | None = None
    ) -> list[FloatArray]:
        """
        Return the residuals of each block after the onset with an effect.

        `throughout`: those with the effect active throughout, if they are known.
        """
        onset_s = active.activation.onset_s or 0.0
        always = ActiveEffect(active.effect, active.theta)
        out = []
        for i, block in enumerate(self.after):
            if onset_s < block.begin_s - WARM_UP_S:
                out.append(block.with_effect(always) if throughout is None else throughout[i])
            elif onset_s > block.end_s:
                out.append(block.residuals)
            else:
                out.append(block.with_effect(active))
        return out

    def onset_losses(self, active: ActiveEffect, onsets_s: FloatArray) -> FloatArray:
        """Return the loss (n,) of an effect with each of the given onsets."""
        throughout = self.residuals(ActiveEffect(active.effect, active.theta, _BEFORE_ALL))
        out = []
        for onset_s in onsets_s:
            moved = ActiveEffect(active.effect, active.theta, Activation(onset_s=float(onset_s)))
            out.append(self.loss(self.residuals(moved, throughout)))
        return np.array(out)

    def reweigh(self, active: ActiveEffect) -> None:
        """Choose the robust weights that belong to an effect."""
        residuals = self.residuals(active)
        for _ in range(2):
            x = self._profile(residuals)
            self._use(
                [
                    robust_weights(r + self._columns_of(block) @ x)
                    for r, block in zip(residuals, self.after, strict=True)
                ]
            )

    def fit(
        self, effect: Effect, theta: Sequence[float], onset_s: float, iterations: int = _ITERATIONS
    ) -> FittedChange:
        """Fit an effect's variables, starting from `theta`."""
        activation = Activation(onset_s=onset_s)
        low, high = np.array([p.bounds() for p in effect.parameters]).T
        steps = np.array([p.step for p in effect.parameters])
        x = np.clip(np.array(theta, dtype=np.float64), low, high)

        def at(value: FloatArray) -> ActiveEffect:
            return ActiveEffect(effect, tuple(float(v) for v in value), activation)

        residuals = self.residuals(at(x))
        loss = self.loss(residuals)
        gradient, normal, scores = self._linearised(at, x, residuals, steps, high)
        for _ in range(iterations):
            move = -np.linalg.lstsq(normal, gradient, rcond=1e-10)[0]
            share, improved = 1.0, False
            for _ in range(_HALVINGS):
                tried = np.clip(x + share * move, low, high)
                new = self.residuals(at(tried))
                new_loss = self.loss(new)
                if new_loss < loss:
                    improved = True
                    break
                share *= 0.3
            if not improved:
                break
            gain, x, residuals, loss = loss - new_loss, tried, new, new_loss
            gradient, normal, scores = self._linearised(at, x, residuals, steps, high)
            if gain < _CONVERGED:
                break
        inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
        count = max(len(self.after), 2)
        robust = inverse @ (count / (count - 1.0) * scores.T @ scores) @ inverse
        deviations = np.sqrt(np.maximum(np.maximum(np.diag(inverse), np.diag(robust)), 0.0))
        block_losses = self._block_losses(residuals, self._profile(residuals))
        return FittedChange(at(x), loss, block_losses, deviations)

    def loss(self, residuals: list[FloatArray]) -> float:
        """Return the loss of the blocks after the onset, static coefficients profiled out."""
        own = sum(
            float(r @ block.weighed(weights, r))
            for block, weights, r in zip(self.after, self._weights, residuals, strict=True)
        )
        right = self._right(residuals)
        return float(own - right @ self._inverse @ right)

    def _right(self, residuals: list[FloatArray]) -> FloatArray:
        products = [x.T @ r for x, r in zip(self._static, residuals, strict=True)]
        return np.asarray(self._right_before + sum(products, np.zeros_like(self._right_before)))

    def _profile(self, residuals: list[FloatArray]) -> FloatArray:
        return np.asarray(-self._inverse @ self._right(residuals))

    def _block_losses(self, residuals: list[FloatArray], x: FloatArray) -> FloatArray:
        out = []
        for block, weights, r in zip(self.after, self._weights, residuals, strict=True):
            left = r + self._columns_of(block) @ x
            out.append(float(left @ block.weighed(weights, left)))
        return np.array(out)

    def _linearised(
        self,
        at: Callable[[FloatArray], ActiveEffect],
        x: FloatArray,
        residuals: list[FloatArray],
        steps: FloatArray,
        high: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return gradient (k,), normal matrix (k, k), and each block's gradient (b, k)."""
        k = x.size
        derivatives: list[list[FloatArray]] = []
        for j in range(k):
            step = steps[j] if x[j] + steps[j] <= high[j] else -steps[j]
            moved = x.copy()
            moved[j] += step
            changed = self.residuals(at(moved))
            derivatives.append([(c - r) / step for c, r in zip(changed, residuals, strict=True)])
        across = np.zeros((self._inverse.shape[0], k))
        normal, scores = np.zeros((k, k)), np.zeros((len(self.after), k))
        coefficients = self._profile(residuals)
        for b, (block, weights, r) in enumerate(
            zip(self.after, self._weights, residuals, strict=True)
        ):
            d = np.column_stack([derivatives[j][b] for j in range(k)])
            seen = block.weighed(weights, d)
            normal += d.T @ seen
            across += self._static[b].T @ d
            scores[b] = seen.T @ (r + self._columns_of(block) @ coefficients)
        projected = normal - across.T @ self._inverse @ across
        return scores.sum(axis=0), projected, scores


def _loss_of(gram: FloatArray, static: IntArray, x: FloatArray) -> float:
    inner = gram[np.ix_(static, static)]
    return float(gram[0, 0] + 2.0 * gram[0, static] @ x + x @ inner @ x)
