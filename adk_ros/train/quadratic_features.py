# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Quadratic features that predict the increments, fitted by least squares before training.

    dx_k / s = c' Q c + l' v + 1 b,   v = [x_k, x_(k-1), x_(k-2), u_k, u_(k-1), u_(k-2)] scaled

with c = v clamped to the range of the training data, or somewhat beyond, so that the forms stay
bounded outside of it. On noise-free data three samples determine the increment almost completely,
and least squares is exact where a trained network is not. The network learns what a quadratic
form cannot express. Speeds above those in the recording are covered by augmented rows
(`speed_augmentation`). Each Q is given by its eigenvectors, c' Q c = sum over j of w_j (d_j'
c)^2: a layer of squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adk_ros.model.lifting.encoder import input_size
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import STATE_NAMES
from adk_ros.train.augmented_regression import RegressionRows, solve, solve_augmented

_MAX_SAMPLES = 3
"""Newest samples that the forms see. Empirical, not calibrated."""
_MAX_ROWS = 200_000
"""
Rows that are fitted to, 1.4 h of driving: with 136 regressors each copy of them takes 0.2 GB, and
there are 1500 of them for each of the 136 coefficients of an equation.
"""
_RIDGES = 1e-11, 1e-8, 1e-8
"""
Ridge for v_x, v_y, yaw rate, per row, in units of scaled regressors. A lower one does not improve
v_y and yaw rate one step ahead and makes them worse over seconds; a higher one costs v_x its
accuracy. Empirical, not calibrated.
"""

_STATE_EXTRAPOLATION, _COMMAND_EXTRAPOLATION = (1.5, 1.0, 1.5), (1.5, 1.5)
"""
Range of the forms, in units of the largest magnitude in the training data. The equations of
motion are nearly products of speed, yaw rate and steering, also somewhat beyond the data; beyond
the largest v_y the tyres saturate, which a quadratic form cannot follow. Chosen on tests of `adk
bench paper`, see doc/method.md.
"""


@dataclass(frozen=True)
class QuadraticFeatures:
    """
    Three forms of an encoder's input row (n,), float32.

    The row is clamped to +-`reach` (n,); `directions` (n, q), `weights` (q, 3), `linear` (n, 3),
    `level` (3,). Names as in the buffers of model folders. `unaugmented`: equations that augmented
    rows are left out of.
    """

    reach: NDArray[np.float32]
    directions: NDArray[np.float32]
    weights: NDArray[np.float32]
    linear: NDArray[np.float32]
    level: NDArray[np.float32]
    unaugmented: tuple[str, ...] = ()

    @staticmethod
    def none(n: int) -> QuadraticFeatures:
        """Return an empty set of forms for rows of `n` columns."""

        def empty(*shape: int) -> Any:
            return np.zeros(shape, dtype=np.float32)

        wide = np.full(n, np.finfo(np.float32).max, dtype=np.float32)
        return QuadraticFeatures(wide, empty(n, 0), empty(0, 0), empty(n, 0), empty(0))


def newest(history: int) -> int:
    """Return the number of samples that the forms see, the newest ones."""
    return min(_MAX_SAMPLES, history + 1)


def input_columns(history: int) -> IntArray:
    """Return the columns of the encoder's input that form v; fewer for a shorter history."""
    samples = newest(history)
    states, first = 3 * samples, 3 * (history + 1)
    commands = 2 * samples if history else 0
    return np.concatenate([np.arange(states), np.arange(first, first + commands)])


@dataclass(frozen=True)
class Rows:
    """
    Augmented rows, made from the measured `rows` (m,): see `speed_augmentation`.

    `states`: [x_k, x_(k-1), ...], each (m, 3), of as many samples as the forms see; `target` (m,
    3); all scaled. `speed` (n,): |v_x| of all samples as measured, m/s. The commands are the
    measured ones.
    """

    rows: IntArray
    states: list[FloatArray]
    target: FloatArray
    speed: FloatArray

    def thinned(self) -> Rows:
        """Return at most `_MAX_ROWS` of the rows, evenly."""
        kept = _kept(self.rows.size)
        states = [values[kept] for values in self.states]
        return Rows(self.rows[kept], states, self.target[kept], self.speed)


def _kept(count: int) -> IntArray:
    """Return which of `count` rows are used."""
    every = np.linspace(0, count - 1, min(count, _MAX_ROWS))
    return np.asarray(every.round(), dtype=np.int64)


def fit_quadratic(
    x: FloatArray,
    u: FloatArray,
    target: FloatArray,
    rows: IntArray,
    history: int,
    augmented: Rows | None = None,
) -> QuadraticFeatures:
    """
    Fit the forms at `rows` of scaled `x` (n, 3), `u` (n, 2) to scaled increments `target` (n, 3).

    Rows with an unknown target are left out, and evenly all above `_MAX_ROWS`. `augmented` rows
    enter the equations that the data do not contradict, with a weight by their accuracy
    (`augmented_regression`).
    """
    rows = rows[np.isfinite(target[rows]).all(axis=1)]
    columns = input_columns(history)
    past = [x[rows - j] for j in range(history + 1)]
    past += [u[rows - j] for j in range(history + 1)] if history else []
    whole = np.concatenate(past, axis=1)
    kept = _kept(rows.size)
    inputs, rows = whole[kept][:, columns], rows[kept]
    i, j = np.triu_indices(columns.size)
    phi = _regressors(inputs)
    size = np.sqrt(np.mean(np.square(phi), axis=0)) + 1e-12
    phi /= size
    speed = np.zeros(len(x)) if augmented is None else augmented.speed
    measured = RegressionRows(inputs, phi, target[rows], rows, speed[rows])
    unaugmented: tuple[str, ...] = ()
    if augmented is None:
        solution = solve(measured, _RIDGES)
    else:
        augmented = augmented.thinned()
        commands = [u[augmented.rows - k] for k in range(newest(history))] if history else []
        values = np.concatenate([*augmented.states, *commands], axis=1)
        made = RegressionRows(
            values,
            _regressors(values) / size,
            augmented.target,
            augmented.rows,
            speed[augmented.rows],
        )
        solution, left_out = solve_augmented(measured, made, _RIDGES)
        unaugmented = tuple(compress(STATE_NAMES, left_out))
    solution /= size[:, None]
    eigen_directions, weights = _quadratic_directions(solution[: i.size], i, j, columns.size)
    n = input_size(history)
    linear, directions, reach = (
        np.zeros((n, 3)),
        np.zeros((n, eigen_directions.shape[1])),
        np.zeros(n),
    )
    linear[columns] = solution[i.size : i.size + columns.size]
    directions[columns] = eigen_directions
    reach[:] = np.abs(whole).max(axis=0)
    reach *= np.concatenate(
        [
            np.tile(_STATE_EXTRAPOLATION, history + 1),
            np.tile(_COMMAND_EXTRAPOLATION, history + 1 if history else 0),
        ]
    )
    single = np.float32
    return QuadraticFeatures(
        reach.astype(single),
        directions.astype(single),
        weights.astype(single),
        linear.astype(single),
        solution[-1].astype(single),
        unaugmented,
    )


def _regressors(inputs: FloatArray) -> FloatArray:
    """Return products of all pairs, the inputs (n, k) and a constant."""
    i, j = np.triu_indices(inputs.shape[1])
    return np.hstack([inputs[:, i] * inputs[:, j], inputs, np.ones((len(inputs), 1))])


def _quadratic_directions(
    coefficients: FloatArray, i: IntArray, j: IntArray, size: int
) -> tuple[FloatArray, FloatArray]:
    """Convert upper triangles (m, 3) of three forms to directions (size, q), weights (q, 3)."""
    # Padded with zeros to a multiple of eight, the width of a vector unit.
    squares = -(-3 * size // 8) * 8
    directions, weights = np.zeros((size, squares)), np.zeros((squares, 3))
    for c in range(3):
        form = np.zeros((size, size))
        form[i, j] = coefficients[:, c]
        values, vectors = np.linalg.eigh(0.5 * (form + form.T))
        block = slice(c * size, (c + 1) * size)
        # The root of the eigenvalue is part of the direction, which conditions float32 better.
        root = np.sqrt(np.abs(values))
        directions[:, block] = vectors * root
        weights[block, c] = np.sign(values)
    return directions, weights
