# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arithmetic of the classical Runge-Kutta step, for models that compute their derivatives."""

from __future__ import annotations

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel


@strict_kernel
def clip(value: float, limit: float) -> float:
    """Return `value` clamped to -limit ... limit."""
    return min(max(value, -limit), limit)


@strict_kernel
def axpy(state: FloatArray, time: float, rate: FloatArray, out: FloatArray) -> None:
    """Write state + time * rate into `out`; all of one length."""
    for j in range(state.shape[0]):
        out[j] = state[j] + time * rate[j]


@strict_kernel
def take_step(state: FloatArray, step: float, work: FloatArray, limit: FloatArray) -> None:
    """Advance `state` (n,) in place by four rates in `work` (>= 4, n), clamped to +-`limit`."""
    for j in range(state.shape[0]):
        change = work[0, j] + 2.0 * (work[1, j] + work[2, j]) + work[3, j]
        state[j] = clip(state[j] + step / 6.0 * change, limit[j])
