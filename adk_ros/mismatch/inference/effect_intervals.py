# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Confidence intervals of an effect's parameters: statistical, and of an inexact equation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.interval import Interval
from adk_ros.mismatch.library.criteria import (
    SYSTEMATIC_ERROR_PER_MATERIALITY,
    SYSTEMATIC_ERROR_PER_SURROGATE_SHARE,
    SYSTEMATIC_ERROR_SHARE,
)
from adk_ros.mismatch.library.effect import EffectParameter
from adk_ros.numerics.constants import QUANTILE_90


def confidence_intervals(
    active: ActiveEffect, deviation: Sequence[float], surrogate_share: float = 0.0
) -> dict[str, Interval]:
    """
    Return an effect's parameters with their 90 % confidence intervals.

    `surrogate_share`: of the residuals' variance, what is the surrogate's own error.
    """
    return {
        parameter.name: confidence_interval(parameter, theta, sigma, surrogate_share)
        for parameter, theta, sigma in zip(
            active.effect.parameters, active.theta, deviation, strict=True
        )
    }


def confidence_interval(
    parameter: EffectParameter, theta: float, sigma: float, surrogate_share: float = 0.0
) -> Interval:
    """
    Return a parameter's 90 % confidence interval.

    The variance of theta is sigma^2 + (share |theta - neutral|)^2 + (share threshold)^2:
    statistical, from the inexact equation, and from the materiality threshold. The equation is
    less exact where much of the residuals' variance, `surrogate_share`, is the surrogate's error.
    """
    foreign = SYSTEMATIC_ERROR_PER_SURROGATE_SHARE * surrogate_share
    relative = float(np.hypot(SYSTEMATIC_ERROR_SHARE, foreign))
    systematic = relative * abs(theta - parameter.theta_neutral)
    if not parameter.inverse:
        floor = SYSTEMATIC_ERROR_PER_MATERIALITY * parameter.materiality_threshold
        systematic = float(np.hypot(systematic, floor))
    half = QUANTILE_90 * float(np.hypot(sigma, systematic))
    ends = sorted(
        parameter.value(max(x, 1e-12) if parameter.inverse else x)
        for x in (theta - half, theta + half)
    )
    return Interval(parameter.value(theta), ends[0], ends[1], parameter.unit)
