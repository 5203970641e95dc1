# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Regression of y on x through the origin, with exponential forgetting."""

from __future__ import annotations

import math


class Slope:
    """
    Running slope and correlation of pairs (x, y), weighted by `forgetting` per pair.

    `xx`, `xy` and `yy` are the weighted sums of the products.
    """

    def __init__(self, forgetting: float) -> None:
        self._forgetting = forgetting
        self.xx = self.xy = self.yy = 0.0

    def add(self, x: float, y: float) -> None:
        """Take over a pair."""
        self.xx = self._forgetting * self.xx + x * x
        self.xy = self._forgetting * self.xy + x * y
        self.yy = self._forgetting * self.yy + y * y

    @property
    def value(self) -> float:
        """Slope xy / xx; NaN without information."""
        return self.xy / self.xx if self.xx > 0.0 else math.nan

    @property
    def correlation(self) -> float:
        """Correlation about the origin, -1 to 1; 0 without information."""
        return self.xy / math.sqrt(self.xx * self.yy) if self.xx > 0.0 < self.yy else 0.0
