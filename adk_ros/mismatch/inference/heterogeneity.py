# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Heterogeneity of estimates of one quantity from several recordings.

Cochran's Q is the sum of squared deviations from the mean, both weighted by the inverse variance.
If the recordings agree, it is chi-squared distributed with K - 1 degrees of freedom
(W. G. Cochran, "The combination of estimates from different experiments", Biometrics 10 (1954)
101). I^2 is the share of the variation that is not chance (J. P. T. Higgins and S. G. Thompson,
"Quantifying heterogeneity in a meta-analysis", Statistics in Medicine 21 (2002) 1539).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from adk_ros.numerics.arrays import FloatArray


class Heterogeneity(NamedTuple):
    """Weighted mean, Cochran's Q with its p-value, and I^2 between 0 and 1."""

    mean: float
    q: float
    p_value: float
    i_squared: float


def heterogeneity(values: FloatArray, deviations: FloatArray) -> Heterogeneity:
    """Return the heterogeneity of estimates (k,) with their standard deviations (k,), k > 1."""
    weights = 1.0 / deviations**2
    mean = float(weights @ values / weights.sum())
    q = float(weights @ (values - mean) ** 2)
    freedom = values.shape[0] - 1
    i_squared = max(0.0, 1.0 - freedom / q) if q > 0.0 else 0.0
    return Heterogeneity(mean, q, float(chdtrc(freedom, q)), i_squared)


def odd_one_out(values: FloatArray, deviations: FloatArray, level: float) -> int | None:
    """
    Return the index of the estimate without which the others agree, or None.

    Of two estimates neither is the odd one.
    """
    count = values.shape[0]
    if count < 3:
        return None
    others = [np.arange(count) != i for i in range(count)]
    rest = [heterogeneity(values[keep], deviations[keep]) for keep in others]
    best = int(np.argmin([each.q for each in rest]))
    return best if rest[best].p_value >= level else None
