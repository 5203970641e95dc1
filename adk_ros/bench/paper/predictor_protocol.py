# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Interface of all predictors in the tables, and the data that they may use."""

from __future__ import annotations

from typing import Protocol

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import Record


class BenchPredictor(Protocol):
    """A named predictor."""

    @property
    def name(self) -> str:
        """Name in the tables."""

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """
        Predict `ahead` steps from each of `rows` (n,), which are in ascending order.

        Returns (n, ahead, 3) in SI units; entry j - 1 is the state at row + j. A prediction may
        use `record.x`, `.u` and `.a` up to its row and the future commands `record.u[row + j]`
        (`u[k]` is in force from tick k on, so `x[k + 1]` depends on it), never `x_ref`.
        `record.episode` marks gaps of the grid. An adaptive predictor processes the earlier rows
        in order. Values that are not finite are scored as diverged.
        """
