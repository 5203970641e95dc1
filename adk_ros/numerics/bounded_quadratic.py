# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Maxima of many concave quadratics within symmetric bounds, at once.

Block principal pivoting (J. J. Júdice, F. M. Pires, "A block principal pivoting algorithm for
large-scale strictly monotone linear complementarity problems", Computers & Operations Research 21
(1994) 587): all entries beyond a bound are put on it, and all on a bound that gain inwards are
released, until none is left. Where that takes long, one entry is exchanged at a time, always the
last, which ends for every positive definite information (K. G. Murty, "Note on a Bard-type scheme
for solving the complementarity problem", Opsearch 11 (1974) 123). SciPy's `lsq_linear` solves one
problem at a time; the selection over a fleet has one per recording and candidate.
"""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.arrays import FloatArray

_BLOCK_STEPS, _MOST_STEPS = 10, 200
"""Exchanges of all entries at once, and in total, before the best feasible point is taken."""
_TOLERANCE = 1e-9
"""Relative rounding error by which a bound may be exceeded, or a slope point inwards."""


def bounded_maxima(informations: FloatArray, scores: FloatArray, bounds: FloatArray) -> FloatArray:
    """
    Return the x (r, k), |x| <= bounds, that maximise each score^T x - x^T information x / 2.

    `informations` (r, k, k), positive definite; `scores` (r, k); `bounds` (k,), positive.

    :raises numpy.linalg.LinAlgError: an information is singular.
    """
    count, size = scores.shape
    side = np.zeros((count, size))
    out = np.zeros((count, size))
    todo = np.arange(count)
    slack = _TOLERANCE * bounds
    for step in range(_MOST_STEPS):
        h, on = informations[todo], side[todo]
        fixed = on != 0.0
        at = on * bounds
        inner = np.where(fixed[:, :, None] | fixed[:, None, :], 0.0, h)
        inner[:, range(size), range(size)] = np.where(fixed, 1.0, np.diagonal(h, axis1=1, axis2=2))
        right = np.where(fixed, at, scores[todo] - np.einsum("rij,rj->ri", h, at))
        x = np.linalg.solve(inner, right[:, :, None])[:, :, 0]
        slope = scores[todo] - np.einsum("rij,rj->ri", h, x)
        beyond = ~fixed & (np.abs(x) > bounds + slack)
        inwards = fixed & (slope * on < -_TOLERANCE * (1.0 + np.abs(scores[todo])))
        wrong = beyond | inwards
        out[todo] = np.clip(x, -bounds, bounds)
        if step >= _BLOCK_STEPS:
            last = size - 1 - np.argmax(wrong[:, ::-1], axis=1)
            wrong &= np.arange(size) == last[:, None]
        side[todo] = np.where(wrong, np.where(fixed, 0.0, np.sign(x)), on)
        todo = todo[wrong.any(axis=1)]
        if not todo.size:
            break
    return out
