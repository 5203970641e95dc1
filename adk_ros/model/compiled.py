# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The two ways in which the model's inner loops are compiled."""

from __future__ import annotations

from pathlib import Path

from adk_ros.compiled import compiler

_HERE = Path(__file__).parent

jit = compiler(_HERE, fastmath=False)
"""Strict arithmetic, for what is summed over many ticks."""
fast = compiler(_HERE, fastmath={"contract", "reassoc"}, error_model="numpy")
"""Sums may be reordered and fused: for the perceptron, which is float32 anyway."""
inlined = compiler(_HERE, fastmath={"contract", "reassoc"}, error_model="numpy", inline="always")
"""As `fast`, for what is called in the innermost loops: a call with its arrays costs as much."""
