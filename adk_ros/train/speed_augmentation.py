# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Augment training data to higher speeds at constant slip angles.

Tyre forces depend on slip angles and loads. Both are the same at b times the speed, lateral
velocity and yaw rate under the same commands. So the specific forces stay the same, except air
drag, and the terms from the rotating frame grow with b squared,

    dv_x/dt = a_x + r v_y,   dv_y/dt = a_y - r v_x,   dr/dt = M / I:

    dv_x' = dv_x + (b^2 - 1) (r v_y - c v_x^2) T,   dv_y' = dv_y - (b^2 - 1) r v_x T,   dr' = dr

over a tick T, with c the drag over mass, by regression. One such row is made from each measured
row, so that quadratic features are valid above the highest recorded speed. The rows are
approximate: over several ticks the slip angles change differently. `augmentation_weight` accounts
for that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import TICK_NS
from adk_ros.train.dataset import Sequences

MAX_SPEED_SCALE = 1.35
"""Largest speed factor b; each row gets a random one from 1 to this. Empirical, not calibrated."""
_AUGMENTATION_TRUST = 0.1
"""
Scale of q in `augmentation_weight`. Chosen on the tests of `adk bench paper`, see doc/method.md.
"""
_SEED = 0
_TICK_S = TICK_NS * 1e-9


@dataclass(frozen=True)
class AugmentedRows:
    """
    Augmented rows, made from the measured `rows` (m,), SI.

    `states`: [x_k, x_(k-1), ...], each (m, 3); `change` (m, 3): x_(k+1) - x_k.
    """

    rows: IntArray
    states: list[FloatArray]
    change: FloatArray


def scale_to_higher_speeds(part: Sequences, past: int) -> AugmentedRows:
    """Return the rows of a part at higher speeds, each with its `past` newest states."""
    rows = part.rows[np.isfinite(part.x_ref[part.rows + 1]).all(axis=1)]
    b = np.random.default_rng(_SEED).uniform(1.0, MAX_SPEED_SCALE, rows.size)
    more = (b * b - 1.0) * _TICK_S
    drag = drag_over_mass(part, rows)

    def changed(begin: FloatArray, end: FloatArray) -> FloatArray:
        out = end - begin
        v_x, v_y, rate = (0.5 * (begin + end)).T
        out[:, 0] += more * (rate * v_y - drag * v_x * v_x)
        out[:, 1] -= more * rate * v_x
        return np.asarray(out)

    states = [b[:, None] * part.x[rows]]
    for j in range(1, past):
        # Backwards from the newest state, whose slip angles are the measured ones.
        states.append(states[-1] - changed(part.x[rows - j], part.x[rows - j + 1]))
    return AugmentedRows(rows, states, changed(part.x[rows], part.x_ref[rows + 1]))


def drag_over_mass(part: Sequences, rows: IntArray) -> float:
    """
    Return c of a_x = ... - c v_x^2 by regression, 1/m, at least zero.

    The other regressors are a constant, the torque, and the cornering drag: (r v_x)^2 and
    r v_x times steering.
    """
    v_x, v_y, rate = part.x[rows].T
    specific_force = (part.x_ref[rows + 1, 0] - part.x[rows, 0]) / _TICK_S - rate * v_y
    torque, delta = part.u[rows].T
    lateral = rate * v_x
    columns = np.column_stack([v_x**2, np.ones(rows.size), torque, lateral**2, lateral * delta])
    size = np.sqrt(np.mean(columns**2, axis=0)) + 1e-12
    solved = np.linalg.lstsq(columns / size, specific_force, rcond=None)[0]
    return max(-float(solved[0] / size[0]), 0.0)


def augmentation_weight(measured: FloatArray, augmented: FloatArray) -> FloatArray:
    """
    Return the weight (3,) of augmented relative to measured rows: w = q^3 / (q^2 + 0.1^2).

    q is the ratio of the mean squares of the residuals (., 3) of a fit to measured rows,
    `measured` over `augmented` rows at recorded speeds. w is about q for noisy data, and much
    smaller for small q, where the error of the augmented rows is systematic and does not average
    out.
    """
    measured_square = np.mean(np.square(measured), axis=0)
    augmented_square = (
        np.mean(np.square(augmented), axis=0) if augmented.size else np.full(3, np.inf)
    )
    q = np.minimum(measured_square / np.maximum(augmented_square, 1e-30), 1.0)
    return np.asarray(q**3 / (q * q + _AUGMENTATION_TRUST * _AUGMENTATION_TRUST))
