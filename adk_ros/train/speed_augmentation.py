# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the data say of speeds that were not driven: the same slip angles, faster.

A tyre feels slip angles and loads, and both are the same at b times the speed, lateral speed and
yaw rate under the same commands. So the accelerations that are felt stay, but for the air's, and
what the frame's rotation adds grows with its square,

    dv_x/dt = a_x + r v_y,   dv_y/dt = a_y - r v_x,   dr/dt = M / I:

    dv_x' = dv_x + (b^2 - 1) (r v_y - c v_x^2) T,   dv_y' = dv_y - (b^2 - 1) r v_x T,   dr' = dr

over a tick T. c is the drag over mass, by regression. Such rows are made of each measured one, for
what is fitted to increments to hold beyond the fastest that was driven. They are no measurements:
over a tick or more the slip angles change in another way. `weight_of` says how much that matters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import TICK_NS
from adk_ros.train.dataset import Sequences

MAX_SPEED_SCALE = 1.35
"""Times the speed, at most: each row is taken at one between this and its own."""
_AUGMENTATION_TRUST = 0.1
_SEED = 0
_TICK_S = TICK_NS * 1e-9


@dataclass(frozen=True)
class AugmentedRows:
    """
    Rows made of the measured `rows` (m,), SI.

    `states` [x_k, x_(k-1), ...] each (m, 3), and the `change` (m, 3) to x_(k+1).
    """

    rows: IntArray
    states: list[FloatArray]
    change: FloatArray


def scale_to_higher_speeds(part: Sequences, past: int) -> AugmentedRows:
    """Return the rows of a part at higher speeds, with `past` states of each."""
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
        # Back from the newest, whose slip angles are the measured ones'.
        states.append(states[-1] - changed(part.x[rows - j], part.x[rows - j + 1]))
    return AugmentedRows(rows, states, changed(part.x[rows], part.x_ref[rows + 1]))


def drag_over_mass(part: Sequences, rows: IntArray) -> float:
    """
    Return c of a_x = ... - c v_x^2, 1/m, at least zero: by regression of what is felt.

    Beside a constant, the torque, and what cornering costs: (r v_x)^2 and r v_x times steering.
    """
    v_x, v_y, rate = part.x[rows].T
    felt = (part.x_ref[rows + 1, 0] - part.x[rows, 0]) / _TICK_S - rate * v_y
    torque, delta = part.u[rows].T
    lateral = rate * v_x
    columns = np.column_stack([v_x**2, np.ones(rows.size), torque, lateral**2, lateral * delta])
    size = np.sqrt(np.mean(columns**2, axis=0)) + 1e-12
    solved = np.linalg.lstsq(columns / size, felt, rcond=None)[0]
    return max(-float(solved[0] / size[0]), 0.0)


def augmentation_weight(measured: FloatArray, made: FloatArray) -> FloatArray:
    """
    Return what a made row weighs beside a measured one (3,): w = q^3 / (q^2 + 0.1^2).

    q is the ratio of mean squares of `measured` over `made` (., 3): what a law fitted to the
    measured rows leaves of both, at speeds that were driven. About q where that is mostly noise;
    far less where q is small, since then made rows are off by what many of them do not average
    away.
    """
    right = np.mean(np.square(measured), axis=0)
    wrong = np.mean(np.square(made), axis=0) if made.size else np.full(3, np.inf)
    q = np.minimum(right / np.maximum(wrong, 1e-30), 1.0)
    return np.asarray(q**3 / (q * q + _AUGMENTATION_TRUST * _AUGMENTATION_TRUST))
