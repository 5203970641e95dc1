# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Affine scaling of states, inputs and state increments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray

_MIN_SCALE = 1e-6
"""Smallest scale, in the channel's unit: a constant channel must not be divided by zero."""
_IGNORED = 1e9
"""
Scale of a command that the training data hold constant: large enough that the network, whose
weights of it never had a gradient, sees none of its changes.
"""


def _deviation(values: FloatArray) -> FloatArray:
    """Return the standard deviations (k,) of values (n, k), one for a constant."""
    return _without_zeros(values.std(axis=0))


def _without_zeros(found: FloatArray) -> FloatArray:
    """Return scales, 1 of a state that does not change."""
    return np.asarray(np.where(found > _MIN_SCALE, found, 1.0))


def _command_scale(found: FloatArray) -> FloatArray:
    """Return scales of commands; of one that did not change, nothing is known but that value."""
    return np.asarray(np.where(found > _MIN_SCALE, found, _IGNORED))


@dataclass(frozen=True)
class Scaling:
    """
    Scaled x = (x - x_mean) / x_scale, u likewise; increments of scaled x in units of `step_scale`.

    `x_mean`, `x_scale` (3,) in m/s, m/s, rad/s; `u_mean`, `u_scale` (2,) in N·m, rad;
    `step_scale` (3,): standard deviation of the increment of scaled x over one tick.
    """

    x_mean: FloatArray
    x_scale: FloatArray
    u_mean: FloatArray
    u_scale: FloatArray
    step_scale: FloatArray

    @staticmethod
    def standard(x: FloatArray, u: FloatArray, change: FloatArray) -> Scaling:
        """
        Scale to zero mean, unit deviation; `change` (n, 3): increments of x over one tick.

        A state that does not change, since it is not measured, keeps its unit.
        """
        x_scale = _deviation(x)
        return Scaling(
            x_mean=x.mean(axis=0),
            x_scale=x_scale,
            u_mean=u.mean(axis=0),
            u_scale=_command_scale(u.std(axis=0)),
            step_scale=_deviation(change) / x_scale,
        )

    @staticmethod
    def min_max(x: FloatArray, u: FloatArray) -> Scaling:
        """Scale to [-1, 1], as the paper does; increments stay in scaled units."""
        x_low, x_high, u_low, u_high = x.min(axis=0), x.max(axis=0), u.min(axis=0), u.max(axis=0)
        return Scaling(
            x_mean=0.5 * (x_low + x_high),
            x_scale=_without_zeros(0.5 * (x_high - x_low)),
            u_mean=0.5 * (u_low + u_high),
            u_scale=_command_scale(0.5 * (u_high - u_low)),
            step_scale=np.ones(3),
        )

    def scale_x(self, x: FloatArray) -> FloatArray:
        """Scale states (..., 3)."""
        return (x - self.x_mean) / self.x_scale

    def scale_u(self, u: FloatArray) -> FloatArray:
        """Scale inputs (..., 2)."""
        return (u - self.u_mean) / self.u_scale

    def unscale_x(self, x: FloatArray) -> FloatArray:
        """Return scaled states (..., 3) in SI units."""
        return x * self.x_scale + self.x_mean
