# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What follows fast changes, beside the matrices that follow slow ones: gains, channel by channel.

    observer     x^_k = p_k + K (x_k - p_k)          p_k: what was predicted for tick k
    slow         d <- d + g_d (e - d)                e: what the model left of the last increment
    fast         f <- f + g_f (e - d - f)            what the slow one leaves of it

K is the gain given as long as innovations x - p are white, as noise makes them. Where each is
like the one before (lag-one autocorrelation r, over some 33 ticks, above 0.3), the model lags
behind the car, and K goes up in proportion, to 1 where r reaches 0.7.

The roll-out adds d and f to its increments; each decays by a factor of its own a step. All are in
units of the usual change in one tick (`Scaling.step_scale`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class ObserverGains:
    """
    Gains and decays, each (3,) for v_x, v_y, yaw rate; decays are factors a tick.

    `observer_gain` 1 takes the measurement as it is; a `slow_gain` or `fast_gain` of 0 switches
    that disturbance off.
    """

    observer_gain: FloatArray
    slow_gain: FloatArray
    slow_decay: FloatArray
    fast_gain: FloatArray
    fast_decay: FloatArray

    @staticmethod
    def none() -> ObserverGains:
        """Nothing but the model."""
        zeros, ones = np.zeros(3), np.ones(3)
        return ObserverGains(ones, zeros, ones, zeros, ones)

    @staticmethod
    def names() -> tuple[str, ...]:
        """Names of the fields."""
        return tuple(field.name for field in fields(ObserverGains))

    def table(self) -> FloatArray:
        """Return the gains and decays as the kernels take them, (5, 3), rows as the fields."""
        return np.array([getattr(self, name) for name in self.names()], dtype=np.float64)
