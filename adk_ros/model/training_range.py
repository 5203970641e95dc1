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

LATERAL_ACCELERATION, SIDESLIP = "lateral_acceleration", "sideslip"
QUANTITIES = (*STATE_NAMES, *INPUT_NAMES, LATERAL_ACCELERATION, SIDESLIP)
"""v_x, v_y, yaw rate, torque, delta, v_x times yaw rate, and the angle of v_y to v_x."""
_NAMES = ("v_x", "v_y", "yaw rate", "torque", "delta", "lateral acceleration", "sideslip")
_UNITS = (*STATE_UNITS, *INPUT_UNITS, "m/s²", "rad")
_MARGIN = 0.1
"""
Share of a range by which a value must lie outside to count as beyond. By choice.

Speeds below this share of the largest count as standstill, where noise makes up the sideslip.
"""
_CENTRAL = (0.5, 99.5)
"""Percentiles that bound the range."""
_REPORTED_SHARE = 0.05
"""Share of starts beyond a range from which it may explain an error. By choice."""


@dataclass(frozen=True)
class TrainingRange:
    """
    The central 99 % of each of `QUANTITIES` in the training data; `low`, `high` (7,), SI.

    Unlimited where it is not known.
    """

    low: FloatArray
    high: FloatArray

    @staticmethod
    def of(records: Sequence[Record]) -> TrainingRange:
        """Return the range of the learnable rows of `records`."""
        x = np.concatenate([r.x[r.learnable] for r in records])
        u = np.concatenate([r.u[r.learnable] for r in records])
        slow = _MARGIN * np.abs(np.nanpercentile(x[:, 0], _CENTRAL)).max()
        rows = _quantities(x, u, slow)
        low, high = np.full((2, rows.shape[1]), np.array([[-math.inf], [math.inf]]))
        known = np.isfinite(rows).any(axis=0)
        low[known], high[known] = np.nanpercentile(rows[:, known], _CENTRAL, axis=0)
        return TrainingRange(low, high)

    def beyond(self, sample: Sample) -> list[str]:
        """Return the quantities of a sample outside the range by a tenth of it, with values."""
        values = self._of(np.array([sample.x]), np.array([sample.u]))[0]
        margin = self._margin()
        texts = []
        for i, value in enumerate(values.tolist()):
            # False for NaN, an unknown value.
            if value < self.low[i] - margin[i] or value > self.high[i] + margin[i]:
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
        rows = np.concatenate([self._of(r.x[at], r.u[at]) for r, at in starts])
        margin = self._margin()
        share = ((rows < self.low - margin) | (rows > self.high + margin)).mean(axis=0)
        return {n: float(s) for n, s in zip(QUANTITIES, share, strict=True) if s > _REPORTED_SHARE}

    def distance(self, states: FloatArray, u: Sequence[float] | FloatArray) -> FloatArray:
        """
        Return how far states (n, 3) and commands, (n, 2) or one (2,), are outside the range, (n,).

        The largest distance of a quantity from its range, in widths of the range; 0 within.
        """
        values = self._of(states, np.broadcast_to(np.asarray(u), (len(states), 2)))
        outside = np.maximum(self.low - values, values - self.high)
        width = self.high - self.low
        known = np.isfinite(width) & (width > 0.0)
        share = outside[:, known] / width[known]
        return np.asarray(np.nan_to_num(share, nan=0.0).max(axis=1, initial=0.0))

    def _of(self, x: FloatArray, u: FloatArray) -> FloatArray:
        """Return the `QUANTITIES` (n, 7); no sideslip where the car hardly moves."""
        fastest = max(abs(float(self.low[0])), abs(float(self.high[0])))
        return _quantities(x, u, _MARGIN * fastest if math.isfinite(fastest) else 0.0)

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


def _quantities(x: FloatArray, u: FloatArray, slow: float) -> FloatArray:
    """Return the `QUANTITIES` (n, 7) of states (n, 3) and commands (n, 2), NaN where unknown."""
    speed = np.abs(x[:, 0])
    slip = np.arctan2(x[:, 1], np.where(speed > slow, speed, math.nan))
    return np.column_stack([x, u, x[:, 0] * x[:, 2], slip])
