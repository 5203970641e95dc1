# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Polynomial sine and arctangent, against the C library."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.elementary import fast_atan, fast_sin
from adk_ros.numerics.numba_cache import relaxed_kernel

ULP = float(np.finfo(float).eps)


@relaxed_kernel
def of_all(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (sine, arctangent) of each value."""
    sine, angle = np.empty_like(x), np.empty_like(x)
    for i in range(x.shape[0]):
        sine[i] = fast_sin(x[i])
        angle[i] = fast_atan(x[i])
    return sine, angle


def test_sine_and_arctangent_agree_with_the_c_library() -> None:
    size = np.concatenate([np.logspace(-9.0, 0.0, 2000), np.linspace(1.0, math.pi, 2000)])
    x = np.concatenate([-size[::-1], [0.0], size])
    sine, angle = of_all(x)
    np.testing.assert_allclose(sine, np.sin(x), rtol=0.0, atol=2.0 * ULP)
    np.testing.assert_allclose(angle, np.arctan(x), rtol=2.0 * ULP, atol=0.0)


def test_the_arctangent_is_continuous_where_its_reduction_changes() -> None:
    for bound in (math.sqrt(2.0) - 1.0, math.sqrt(2.0) + 1.0):
        x = bound + ULP * np.arange(-50.0, 51.0)
        np.testing.assert_allclose(of_all(x)[1], np.arctan(x), rtol=2.0 * ULP, atol=0.0)


def test_the_sine_has_its_period() -> None:
    x = np.linspace(-40.0, 40.0, 4001)
    np.testing.assert_allclose(of_all(x)[0], np.sin(x), rtol=0.0, atol=40.0 * ULP)


@pytest.mark.parametrize("x", [1e3, 1e300])
def test_the_arctangent_has_its_limit(x: float) -> None:
    assert of_all(np.array([x]))[1][0] == pytest.approx(math.atan(x), rel=2.0 * ULP)
