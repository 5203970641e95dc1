# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Gains of the observer and of the two disturbance estimators, per channel.

    observer     x^_k = p_k + K (x_k - p_k)          p_k: prediction for tick k
    slow         d <- d + g_d (e - d)                e: one-step residual of the model's increment
    fast         f <- f + g_f (e - d - f)            residual after the slow estimate

K is the given gain as long as the innovations x - p are white, as measurement noise makes them.
If their lag-one autocorrelation r, over about 33 ticks, exceeds 0.3, the model lags the vehicle
and K increases linearly up to 1 at r = 0.7.

A rollout adds d and f to its increments; each decays by its own factor per step. Disturbances are
in units of the typical increment in one tick (`Scaling.step_scale`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class ObserverGains:
    """
    Gains and decays, each (3,) for v_x, v_y, yaw rate; decays are factors per tick.

    An `observer_gain` of 1 takes the measurement unfiltered; a `slow_gain` or `fast_gain` of 0
    switches that disturbance estimator off.
    """

    observer_gain: FloatArray
    slow_gain: FloatArray
    slow_decay: FloatArray
    fast_gain: FloatArray
    fast_decay: FloatArray

    @staticmethod
    def none() -> ObserverGains:
        """Return gains that switch observer and disturbance estimators off."""
        zeros, ones = np.zeros(3), np.ones(3)
        return ObserverGains(ones, zeros, ones, zeros, ones)

    @staticmethod
    def names() -> tuple[str, ...]:
        """Return the names of the fields."""
        return tuple(field.name for field in fields(ObserverGains))

    def table(self) -> FloatArray:
        """Return gains and decays as the kernels read them, (5, 3), one row per field."""
        return np.array([getattr(self, name) for name in self.names()], dtype=np.float64)
