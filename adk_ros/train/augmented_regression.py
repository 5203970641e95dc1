# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Least squares on measured rows and on rows augmented to higher speeds.

An augmented row has the weight that its accuracy at recorded speeds is worth
(`speed_augmentation.augmentation_weight`). The augmentation assumes that forces depend on slip
angles and torque commands only: not on a car with downforce, whose grip grows with the speed, nor
on one at its power limit, whose torque falls with it. So it is tested where the data can
contradict it: rows up to v_max / `MAX_SPEED_SCALE` are augmented to the speeds above, which were
driven as well. An equation that predicts those rows worse with augmented rows than without them
gets none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import stdtrit

from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.train.speed_augmentation import MAX_SPEED_SCALE, augmentation_weight

_BLOCK = 200
"""Samples of a block: 5 s. Errors of different blocks count as independent. By choice."""
_MIN_BLOCKS = 4
"""Fewer blocks above the limit of speed contradict nothing. By choice."""
_FALSE_ALARM = 0.05
"""Probability that chance contradicts the augmentation of an equation. Convention."""


@dataclass(frozen=True)
class RegressionRows:
    """
    Rows of a regression.

    `inputs` (n, k), of which the regressors `phi` (n, m) are made; `target` (n, 3); `sample` (n,):
    number of the newest measured sample; `speed` (n,): |v_x| of that sample, m/s.
    """

    inputs: FloatArray
    phi: FloatArray
    target: FloatArray
    sample: IntArray
    speed: FloatArray

    @cached_property
    def gram(self) -> FloatArray:
        """Return the products (m, m) of the regressors."""
        return np.asarray(self.phi.T @ self.phi)

    def where(self, chosen: BoolArray) -> RegressionRows:
        """Return the `chosen` (n,) rows."""
        return RegressionRows(
            self.inputs[chosen],
            self.phi[chosen],
            self.target[chosen],
            self.sample[chosen],
            self.speed[chosen],
        )

    def errors(self, solution: FloatArray) -> FloatArray:
        """Return the residuals (n, 3) of coefficients (m, 3)."""
        return self.phi @ solution - self.target


def solve(
    measured: RegressionRows,
    ridges: Sequence[float],
    augmented: RegressionRows | None = None,
    weight: FloatArray | None = None,
) -> FloatArray:
    """
    Return the coefficients (m, 3) of a ridge regression.

    `ridges` (3,): per measured row. `weight` (3,): of the augmented rows, by equation.
    """
    right = measured.phi.T @ measured.target
    grams = [measured.gram] * 3
    if augmented is not None and weight is not None:
        right = right + augmented.phi.T @ (weight * augmented.target)
        grams = [measured.gram + w * augmented.gram for w in weight]
    penalty = len(measured.phi) * np.eye(measured.phi.shape[1])
    return np.stack(
        [np.linalg.solve(grams[c] + ridges[c] * penalty, right[:, c]) for c in range(3)], axis=1
    )


def solve_augmented(
    measured: RegressionRows, augmented: RegressionRows, ridges: Sequence[float]
) -> tuple[FloatArray, BoolArray]:
    """
    Return the coefficients (m, 3), and the equations (3,) that contradict the augmented rows.

    These rows enter the other equations only.
    """
    alone = solve(measured, ridges)
    left_out = contradicted(measured, augmented, ridges)
    weight = np.where(left_out, 0.0, _weight(measured, augmented, alone))
    return solve(measured, ridges, augmented, weight), left_out


def contradicted(
    measured: RegressionRows, augmented: RegressionRows, ridges: Sequence[float]
) -> BoolArray:
    """
    Return the equations (3,) in which augmented slow rows make the fast ones less predictable.

    That is, where the difference of the squared errors, by blocks of 5 s, is greater than zero by
    a one-sided paired t-test at 5 %.
    """
    limit = measured.speed.max(initial=0.0) / MAX_SPEED_SCALE
    slow, fast = (measured.where(x) for x in (measured.speed <= limit, measured.speed > limit))
    made = augmented.where(augmented.speed <= limit)
    blocks, block = np.unique(fast.sample // _BLOCK, return_inverse=True)
    n = blocks.size
    # A fit to as few rows as regressors shows nothing.
    if n < _MIN_BLOCKS or len(slow.phi) < 2 * slow.phi.shape[1]:
        return np.zeros(3, dtype=bool)
    alone = solve(slow, ridges)
    helped = solve(slow, ridges, made, _weight(slow, made, alone))
    more = fast.errors(helped) ** 2 - fast.errors(alone) ** 2
    sums = np.stack([np.bincount(block, more[:, c], n) for c in range(3)], axis=1)
    deviation = np.maximum(sums.std(axis=0, ddof=1) / np.sqrt(n), 1e-300)
    return np.asarray(sums.mean(axis=0) > stdtrit(n - 1, 1.0 - _FALSE_ALARM) * deviation)


def _weight(
    measured: RegressionRows, augmented: RegressionRows, solution: FloatArray
) -> FloatArray:
    """Return the weight (3,) of augmented rows, by their errors within the range of the data."""
    reach = np.abs(measured.inputs).max(axis=0)
    within_data = (np.abs(augmented.inputs) <= reach).all(axis=1)
    return augmentation_weight(
        measured.errors(solution), augmented.where(within_data).errors(solution)
    )
