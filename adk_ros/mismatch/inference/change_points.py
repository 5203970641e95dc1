# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Effects that begin in the middle of a recording: a scan over when."""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.inference.likelihood import ActiveEffect
from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.surrogate.activation import Activation

MIN_DISTANCE_TO_END_S = 15.0
"""A beginning nearer than this to either end of the recording is not looked for."""


def locate_change_point(
    screen: LinearisedProblem, active: ActiveEffect
) -> tuple[float, ActiveEffect] | None:
    """
    Return the linear gain and the effect with the onset at which it gains most, or None.

    `active` gives the size at which the derivative is taken. With s the effect's column and e what
    is left, the gain of acting from t on is (sum over later s e)^2 / (sum over later s^2).
    """
    likelihood = screen.likelihood
    course = likelihood.problem
    column = screen.column(active)
    bins = course.bins
    size = 6 * bins
    s = column[:size].reshape(6, bins)
    e = screen.left[:size].reshape(6, bins)
    both = np.cumsum((s * e).sum(axis=0)[::-1])[::-1]
    own = np.cumsum((s * s).sum(axis=0)[::-1])[::-1]
    gain = np.where(own > 1e-6, both**2 / np.maximum(own, 1e-6), 0.0)
    share = -both / np.maximum(own, 1e-6)
    at = course.bin_s
    allowed = (
        (at > course.start_s + MIN_DISTANCE_TO_END_S)
        & (at < at[-1] - MIN_DISTANCE_TO_END_S)
        & (share > 0.0)
    )
    if not allowed.any():
        return None
    best = int(np.argmax(np.where(allowed, gain, -1.0)))
    gate = Activation(onset_s=float(at[best]))
    inner = []
    for parameter, x in zip(active.effect.parameters, active.theta, strict=True):
        neutral = parameter.theta_neutral
        value = x if parameter.starts else neutral + (x - neutral) * float(share[best])
        inner.append(float(np.clip(value, *parameter.bounds())))
    return float(gain[best]), ActiveEffect(active.effect, tuple(inner), gate)
