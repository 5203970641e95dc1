# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Filters of evenly sampled signals."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.numerics.filters import causal_filter


@pytest.mark.parametrize("taps", [1, 5, 40])
def test_a_causal_filter_is_a_convolution(taps: int) -> None:
    rng = np.random.default_rng(taps)
    signal, weights = rng.normal(size=30), rng.normal(size=taps)
    expected = np.convolve(signal, weights)[:30]
    np.testing.assert_allclose(causal_filter(signal, weights), expected, atol=1e-12)
