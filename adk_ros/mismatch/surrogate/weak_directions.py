# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Directions of the parameter space that a simulation determines poorly: they become nuisances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE, default_parameters
from adk_ros.numerics.arrays import FloatArray

_BODY_MOTION_PARAMETERS = (
    "roll_gradient",
    "roll_frequency",
    "roll_damping",
    "roll_arm",
    "pitch_gradient",
    "pitch_frequency",
    "pitch_damping",
    "load_springs",
)
"""
Parameters of the sprung mass. A simulator without suspension leaves all of them undetermined, and
they then change no other recording either: they do not count as weakly identified.
"""
_WEAK_DIRECTION_SHARE = 0.1
"""Directions identified to better than this share of the prior's deviation count as known."""
_SLIP_COMPLIANCE = INDEX["slip_compliance"]
_PRIOR_INFLATION = 2.0
"""Factor on the deviation of weakly identified directions: linearisation understates it."""
_MAX_WEAK_DIRECTIONS = 6


def weakly_identified_directions(
    normal: FloatArray, sigma: FloatArray, names: Sequence[str]
) -> FloatArray:
    """
    Return the weakly identified directions (k, SIZE) of a fit, each one standard deviation long.

    `normal` (n, n): normal matrix of the fit of the parameters `names`, `sigma` (n,) their prior
    standard deviations.

    The last is the slip compliance, which no simulation determines: it only acts on wheels whose
    inertia differs from the simulation's. Its deviation is its value, since it may be zero.
    """
    determined = np.array([name not in _BODY_MOTION_PARAMETERS for name in names])
    index = np.array([INDEX[name] for name in names])[determined]
    normal, sigma = normal[np.ix_(determined, determined)], sigma[determined]
    values, vectors = np.linalg.eigh(normal * np.outer(sigma, sigma))
    deviation = _PRIOR_INFLATION / np.sqrt(np.maximum(values, 1.0))
    slip = np.zeros(SIZE)
    slip[_SLIP_COMPLIANCE] = default_parameters()[_SLIP_COMPLIANCE]
    out: list[FloatArray] = []
    for size, vector in zip(deviation, vectors.T, strict=True):
        if size > _WEAK_DIRECTION_SHARE * _PRIOR_INFLATION and len(out) < _MAX_WEAK_DIRECTIONS:
            row = np.zeros(SIZE)
            row[index] = min(size, 1.0) * vector * sigma
            out.append(row)
    return np.array([*out, slip])
