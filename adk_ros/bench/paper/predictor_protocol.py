# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What every predictor in the tables has to offer, and what it may know."""

from __future__ import annotations

from typing import Protocol

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import Record


class BenchPredictor(Protocol):
    """A predictor under a name."""

    @property
    def name(self) -> str:
        """As the tables print it."""

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """
        Predict `ahead` steps from each of `rows` (n,), which are in ascending order.

        Returns (n, ahead, 3) in SI units, entry j - 1 the state at row + j. From a row only
        `record.x`, `.u` and `.a` up to it may be used, and the commands ahead, `record.u[row + j]`
        (`u[k]` is in force from tick k on, so that `x[k + 1]` depends on it); never `x_ref`.
        `record.episode` tells where the grid breaks. A predictor that adapts runs through the
        rows before in order. What is not finite is scored as diverged.
        """
