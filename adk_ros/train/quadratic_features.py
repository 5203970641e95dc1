# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Quadratic forms that predict the increments, fitted by least squares before anything is trained.

    dx_k / s = c' Q c + l' v + 1 b,   v = [x_k, x_(k-1), x_(k-2), u_k, u_(k-1), u_(k-2)] scaled

with c the same as v but held within, or somewhat beyond, what the training data show, so that
the forms do not grow without bound outside of it. On noise-free data three past states tell
nearly all there is to know, and a solved problem is exact where a trained network is not: what is
left to the network is what a quadratic form cannot express, and to multi-step training what one
step cannot show. Beyond the speeds that were driven, rows that were made of measured ones stand in
(`faster`). Each Q is given by its eigenvectors, c' Q c = sum over j of w_j (d_j' c)^2,
which is a layer of squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adk_ros.model.lifting.encoder import input_size
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.train.speed_augmentation import augmentation_weight

_NEWEST_COLUMNS = 3
_RIDGES = 1e-11, 1e-8, 1e-8
"""
For v_x, v_y, yaw rate, per row, in units of scaled regressors. A weaker one makes v_y and yaw rate
no better one step ahead, and worse in seconds; a stronger one costs v_x most of its digits.
"""

_STATE_EXTRAPOLATION, _COMMAND_EXTRAPOLATION = (1.5, 1.0, 1.5), (1.5, 1.5)
"""
How far the forms are believed, in units of what the training data show. A car's equations are
nearly products of speed, yaw rate and steering, and stay so somewhat farther out; but beyond the
largest v_y that was seen lies the sliding tyre, where a form would run away.
"""


@dataclass(frozen=True)
class QuadraticFeatures:
    """
    Three forms of an encoder's input row (n,), float32.

    The row enters held within +-`reach` (n,), what the training data show; `directions` (n, q),
    `weights` (q, 3), `linear` (n, 3), `level` (3,).
    """

    reach: NDArray[np.float32]
    directions: NDArray[np.float32]
    weights: NDArray[np.float32]
    linear: NDArray[np.float32]
    level: NDArray[np.float32]

    @staticmethod
    def none(n: int) -> QuadraticFeatures:
        """No forms, for rows of `n`."""

        def empty(*shape: int) -> Any:
            return np.zeros(shape, dtype=np.float32)

        wide = np.full(n, np.finfo(np.float32).max, dtype=np.float32)
        return QuadraticFeatures(wide, empty(n, 0), empty(0, 0), empty(n, 0), empty(0))


def newest(history: int) -> int:
    """Return how many samples the forms see, the newest ones."""
    return min(_NEWEST_COLUMNS, history + 1)


def input_columns(history: int) -> IntArray:
    """Columns of the encoder's input that hold v, see above; fewer for a shorter history."""
    samples = newest(history)
    states, first = 3 * samples, 3 * (history + 1)
    commands = 2 * samples if history else 0
    return np.concatenate([np.arange(states), np.arange(first, first + commands)])


@dataclass(frozen=True)
class Rows:
    """
    Rows that were made of measured ones, `rows` (m,): see `faster`.

    `states` [x_k, x_(k-1), ...] each (m, 3), of as many samples as the forms see, and `target`
    (m, 3), all scaled. The commands are the measured ones.
    """

    rows: IntArray
    states: list[FloatArray]
    target: FloatArray


def fit_quadratic(
    x: FloatArray,
    u: FloatArray,
    target: FloatArray,
    rows: IntArray,
    history: int,
    made: Rows | None = None,
) -> QuadraticFeatures:
    """
    Fit the forms at `rows` of scaled `x` (n, 3), `u` (n, 2); `target` (n, 3) the scaled increment.

    Rows whose target is not known are left out. `made` rows weigh as much less than measured ones
    as forms without them are worse there.
    """
    rows = rows[np.isfinite(target[rows]).all(axis=1)]
    columns = input_columns(history)
    past = [x[rows - j] for j in range(history + 1)]
    past += [u[rows - j] for j in range(history + 1)] if history else []
    inputs = np.concatenate(past, axis=1)[:, columns]
    i, j = np.triu_indices(columns.size)
    products = inputs[:, i] * inputs[:, j]
    phi = np.hstack([products, inputs, np.ones((rows.size, 1))])
    size = np.sqrt(np.mean(np.square(phi), axis=0)) + 1e-12
    phi /= size
    gram, right = phi.T @ phi, phi.T @ target[rows]
    ridges = [ridge * rows.size * np.eye(len(gram)) for ridge in _RIDGES]
    solution = np.stack([np.linalg.solve(gram + ridges[c], right[:, c]) for c in range(3)], axis=1)
    if made is not None:
        more = [u[made.rows - k] for k in range(newest(history))] if history else []
        there = np.concatenate([*made.states, *more], axis=1)
        beyond = np.hstack([there[:, i] * there[:, j], there, np.ones((len(there), 1))]) / size
        driven = (np.abs(there) <= np.abs(inputs).max(axis=0)).all(axis=1)
        weight = augmentation_weight(
            phi @ solution - target[rows], beyond[driven] @ solution - made.target[driven]
        )
        also, towards = beyond.T @ beyond, beyond.T @ (weight * made.target)
        solution = np.stack(
            [
                np.linalg.solve(gram + weight[c] * also + ridges[c], right[:, c] + towards[:, c])
                for c in range(3)
            ],
            axis=1,
        )
    solution /= size[:, None]
    own, weights = _quadratic_directions(solution[: i.size], i, j, columns.size)
    n = input_size(history)
    linear, directions, reach = np.zeros((n, 3)), np.zeros((n, own.shape[1])), np.zeros(n)
    linear[columns] = solution[i.size : i.size + columns.size]
    directions[columns] = own
    reach[:] = np.abs(np.concatenate(past, axis=1)).max(axis=0)
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
    )


def _quadratic_directions(
    coefficients: FloatArray, i: IntArray, j: IntArray, size: int
) -> tuple[FloatArray, FloatArray]:
    """Upper triangles (m, 3) of three forms -> directions (size, q), weights (q, 3)."""
    # Filled up with nothing: a vector unit takes eight at a time, and single ones are slow.
    squares = -(-3 * size // 8) * 8
    directions, weights = np.zeros((size, squares)), np.zeros((squares, 3))
    for c in range(3):
        form = np.zeros((size, size))
        form[i, j] = coefficients[:, c]
        values, vectors = np.linalg.eigh(0.5 * (form + form.T))
        block = slice(c * size, (c + 1) * size)
        # The weight's root goes into the direction, so that both are of like size in float32.
        root = np.sqrt(np.abs(values))
        directions[:, block] = vectors * root
        weights[block, c] = np.sign(values)
    return directions, weights
