# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Filters of evenly sampled signals."""

from __future__ import annotations

import math

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import relaxed_kernel, strict_kernel


@relaxed_kernel
def causal_filter(signal: FloatArray, taps: FloatArray) -> FloatArray:
    """Return the sum over j of taps[j] signal[k - j] (n,), at rest before the signal."""
    n = signal.shape[0]
    out = np.zeros(n)
    for j in range(min(taps.shape[0], n)):
        tap = taps[j]
        # Along the signal, which the compiler vectorises, not along the taps.
        for k in range(n - j):
            out[k + j] += tap * signal[k]
    return out


@strict_kernel
def low_pass(signal: FloatArray, step: float, tau: float) -> FloatArray:
    """Return a first-order lag (n,) of a signal, tau y' = s - y, at rest in its first value."""
    out = np.empty_like(signal)
    keep = math.exp(-step / tau) if tau > 0.0 else 0.0
    value = signal[0]
    for k in range(signal.shape[0]):
        value = signal[k] + (value - signal[k]) * keep
        out[k] = value
    return out


@strict_kernel
def resonance(signal: FloatArray, step: float, omega: float, damping: float) -> FloatArray:
    """
    Return w^2 x + 2 z w x' (n,) with x'' + 2 z w x' + w^2 x = s.

    Semi-implicit Euler steps, at rest in the first value of the signal.
    """
    out = np.empty_like(signal)
    stiffness, friction = omega * omega, 2.0 * damping * omega
    x, v = signal[0] / stiffness, 0.0
    for k in range(signal.shape[0]):
        v = (v + step * (signal[k] - stiffness * x)) / (1.0 + step * friction)
        x += step * v
        out[k] = stiffness * x + friction * v
    return out


@strict_kernel
def stop_operator(signal: FloatArray, width: float) -> FloatArray:
    """
    Return the stress (n,) of a spring in series with dry friction, from zero.

    It follows the changes of the signal and stays within +-width: the hysteretic part of backlash
    and of an elastic, perfectly plastic element (Brokate and Sprekels, Hysteresis and Phase
    Transitions, 1996, section 2.1).
    """
    out = np.empty_like(signal)
    stress = 0.0
    for k in range(signal.shape[0]):
        if k > 0:
            stress += signal[k] - signal[k - 1]
        stress = min(max(stress, -width), width)
        out[k] = stress
    return out
