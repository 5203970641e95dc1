# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sine and arctangent for compiled loops, as polynomials that the compiler inlines.

A call of the C library costs more than its arithmetic and keeps independent evaluations (four
wheels) from overlapping. The coefficients are those of the Chebyshev interpolation of
atan(sqrt t) / sqrt t on [0, tan^2(pi/8)] and of sin(sqrt t) / sqrt t on [0, (pi/2)^2], of 11 and 9
terms: interpolation errors of 4e-17 and 2e-19, below the rounding of double precision.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.numerics.numba_cache import inlined_kernel

_TAN_22_5, _TAN_67_5 = math.sqrt(2.0) - 1.0, math.sqrt(2.0) + 1.0


@inlined_kernel
def fast_atan(x: float) -> float:
    """Return atan(x) of a finite x, rad; absolute error below 4e-16."""
    size = abs(x)
    # atan a = pi/4 + atan((a - 1) / (a + 1)) = pi/2 - atan(1 / a); without branches, so that the
    # compiler can vectorise a loop of calls.
    is_large, is_middle = size > _TAN_67_5, size > _TAN_22_5
    dividend = -1.0 if is_large else (size - 1.0 if is_middle else size)
    divisor = size if is_large else (size + 1.0 if is_middle else 1.0)
    offset = 0.5 * math.pi if is_large else (0.25 * math.pi if is_middle else 0.0)
    reduced = dividend / divisor
    t = reduced * reduced
    t2 = t * t
    t4 = t2 * t2
    low = (1.0 - 0.3333333333332844 * t) + t2 * (0.1999999999885511 - 0.14285714180976467 * t)
    middle = (0.11111106180455946 - 0.09090773074808414 * t) + t2 * (
        0.07689953496306857 - 0.06640233930429408 * t
    )
    high = (0.056883492268090106 - 0.04348052215716462 * t) + t2 * 0.021135373157693246
    return math.copysign(offset + reduced * (low + t4 * (middle + t4 * high)), x)


@inlined_kernel
def fast_sin(x: float) -> float:
    """Return sin(x), x in rad; absolute error below 4e-16 for |x| <= pi, and growing with |x|."""
    turns: float = np.floor(x / math.pi + 0.5)
    r = x - turns * math.pi
    t = r * r
    t2 = t * t
    t4 = t2 * t2
    low = (1.0 - 0.16666666666666666 * t) + t2 * (
        0.008333333333333186 - 0.00019841269841208676 * t
    )
    high = (2.7557319211229606e-06 - 2.505210689056952e-08 * t) + t2 * (
        1.605894087848656e-10 - 7.643026557971632e-13 * t
    )
    sine = r * (low + t4 * (high + t4 * 2.7215749422983443e-15))
    half = 0.5 * turns
    odd: float = 2.0 * (half - np.floor(half))
    return sine * (1.0 - 2.0 * odd)
