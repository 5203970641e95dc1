# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the model's inner loops are compiled, and kept where a folder can be written to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(**options: Any) -> Callable[[Any], Any]:
    """Return numba's `njit` with `options`, cached on disk if that is possible."""

    def decorate(function: Any) -> Any:
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError:
            # Neither the package nor the home folder may be written to: compile at each start.
            return njit(**options)(function)

    return decorate


jit = compiled(fastmath=False)
"""Strict arithmetic, for what is summed over many ticks."""
fast = compiled(fastmath={"contract", "reassoc"}, error_model="numpy")
"""Sums may be reordered and fused: for the perceptron, which is float32 anyway."""
