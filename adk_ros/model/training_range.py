# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The range of the data that a model was trained on, and what lies beyond it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import (
    INPUT_NAMES,
    INPUT_UNITS,
    STATE_NAMES,
    STATE_UNITS,
    Record,
    Sample,
)

LATERAL_ACCELERATION = "lateral_acceleration"
QUANTITIES = (*STATE_NAMES, *INPUT_NAMES, LATERAL_ACCELERATION)
"""v_x, v_y, yaw rate, torque, delta, and v_x times yaw rate."""
_NAMES = ("v_x", "v_y", "yaw rate", "torque", "delta", "lateral acceleration")
_UNITS = (*STATE_UNITS, *INPUT_UNITS, "m/s²")
_MARGIN = 0.1
"""Share of a range by which a value must lie outside to count as beyond. By choice."""
_REPORTED_SHARE = 0.05
"""Share of starts beyond a range from which it may explain an error. By choice."""


@dataclass(frozen=True)
class TrainingRange:
    """
    The central 99 % of each of `QUANTITIES` in the training data; `low`, `high` (6,), SI.

    Unlimited where it is not known.
    """

    low: FloatArray
    high: FloatArray

    @staticmethod
    def of(records: Sequence[Record]) -> TrainingRange:
        """Return the range of the learnable rows of `records`."""
        rows = np.concatenate([_quantities(r.x, r.u)[r.learnable] for r in records])
        low, high = np.nanpercentile(rows, [0.5, 99.5], axis=0)
        return TrainingRange(low, high)

    def beyond(self, sample: Sample) -> list[str]:
        """Return the quantities of a sample outside the range by a tenth of it, with values."""
        values = _quantities(np.array([sample.x]), np.array([sample.u]))[0]
        margin = self._margin()
        texts = []
        for i, value in enumerate(values.tolist()):
            if self.low[i] - margin[i] <= value <= self.high[i] + margin[i]:
                continue
            if math.isfinite(value):
                limits = f"{self.low[i]:.3g} to {self.high[i]:.3g}"
                texts.append(f"{_NAMES[i]} {value:.3g} {_UNITS[i]} (trained on {limits})")
        return texts

    @property
    def text(self) -> str:
        """It as a line."""
        return ", ".join(
            f"{name} {low:.3g} to {high:.3g} {unit}"
            for name, unit, low, high in zip(_NAMES, _UNITS, self.low, self.high, strict=True)
            if math.isfinite(low)
        )

    def share_beyond(self, starts: Sequence[tuple[Record, IntArray]]) -> dict[str, float]:
        """Return the share of rows outside the range by a tenth of it, for shares over 5 %."""
        rows = np.concatenate([_quantities(r.x, r.u)[at] for r, at in starts])
        margin = self._margin()
        share = ((rows < self.low - margin) | (rows > self.high + margin)).mean(axis=0)
        return {n: float(s) for n, s in zip(QUANTITIES, share, strict=True) if s > _REPORTED_SHARE}

    def _margin(self) -> FloatArray:
        width = self.high - self.low
        return np.where(np.isfinite(width), _MARGIN * width, 0.0)

    def as_json(self) -> dict[str, list[float]]:
        """Return [low, high] by quantity."""
        pairs = zip(self.low.tolist(), self.high.tolist(), strict=True)
        return dict(zip(QUANTITIES, map(list, pairs), strict=True))

    @staticmethod
    def from_json(stored: dict[str, list[float]] | None) -> TrainingRange | None:
        """Return the range that `as_json` stored; None without one."""
        if not stored:
            return None
        table = np.array([stored.get(name, [-math.inf, math.inf]) for name in QUANTITIES])
        return TrainingRange(table[:, 0], table[:, 1])


def _quantities(x: FloatArray, u: FloatArray) -> FloatArray:
    """Return the `QUANTITIES` (n, 6) of states (n, 3) and commands (n, 2)."""
    return np.column_stack([x, u, x[:, 0] * x[:, 2]])
