# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Change-point detection: the time from which an effect acts."""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.score_test import Candidate, LinearisedProblem
from adk_ros.mismatch.library.criteria import MIN_DISTANCE_TO_END_S
from adk_ros.mismatch.surrogate.activation import Activation

_MIN_COLUMN_ENERGY = 1e-6


def locate_change_point(linearised: LinearisedProblem, active: ActiveEffect) -> Candidate | None:
    """
    Return the effect with the onset of the largest linearised gain, or None.

    `active` gives the size at which the derivative is taken. With s the effect's column and e the
    projected residuals, an onset at t gains about (sum over later s e)^2 / (sum over later s^2);
    that of the best onset is then computed with the other parameters fitted again.
    """
    problem = linearised.likelihood.problem
    column = linearised.column(active)
    bins = problem.bins
    n = 6 * bins
    s = column[:n].reshape(6, bins)
    e = linearised.projected[:n].reshape(6, bins)
    product = np.cumsum((s * e).sum(axis=0)[::-1])[::-1]
    energy = np.cumsum((s * s).sum(axis=0)[::-1])[::-1]
    bounded = np.maximum(energy, _MIN_COLUMN_ENERGY)
    gain = np.where(energy > _MIN_COLUMN_ENERGY, product**2 / bounded, 0.0)
    share = -product / bounded
    onset_s = problem.bin_s
    allowed = (
        (onset_s > problem.start_s + MIN_DISTANCE_TO_END_S)
        & (onset_s < onset_s[-1] - MIN_DISTANCE_TO_END_S)
        & (share > 0.0)
    )
    if not allowed.any():
        return None
    best = int(np.argmax(np.where(allowed, gain, -1.0)))
    later = np.tile(onset_s >= onset_s[best], 6)
    masked = np.zeros_like(column)
    masked[:n] = np.where(later, column[:n], 0.0)
    size, exact = linearised.solve(masked[:, None])
    if size[0] <= 0.0:
        return None
    activation = Activation(onset_s=float(onset_s[best]))
    theta = []
    for parameter, x in zip(active.effect.parameters, active.theta, strict=True):
        neutral = parameter.theta_neutral
        value = x if parameter.starts else neutral + (x - neutral) * float(size[0])
        theta.append(float(np.clip(value, *parameter.bounds())))
    return Candidate(ActiveEffect(active.effect, tuple(theta), activation), exact)
