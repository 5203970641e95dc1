# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Result of one tick of the predictor."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel


class Status(Enum):
    """Why a tick has a prediction, or has none."""

    PREDICTED = "predicted"
    WARMING_UP = "warming up"
    COASTING = "coasting"
    NO_STATE = "no state"
    IMPLAUSIBLE = "implausible"


class Prediction(NamedTuple):
    """
    The state predicted one tick ahead, at `stamp_ns`, from the sample at `origin_ns`.

    `x` (3,), `covariance` (3, 3), `horizon` (steps, 3) and its `horizon_covariance` (steps, 3,
    3), all SI. `innovation` (3,): measured minus predicted state of the present sample, NaN if
    there was no prediction for it. `planned_steps`: over how many steps of the horizon torque and
    delta follow a plan; over the others they are held.
    """

    origin_ns: int
    stamp_ns: int
    x: FloatArray
    covariance: FloatArray
    horizon: FloatArray
    horizon_covariance: FloatArray
    innovation: FloatArray
    status: Status
    planned_steps: tuple[int, int] = (0, 0)

    def is_finite(self) -> bool:
        """Return whether all that is published of it is finite."""
        return _all_finite(self.x, self.covariance, self.horizon, self.horizon_covariance)


@strict_kernel
def _all_finite(
    x: FloatArray, covariance: FloatArray, horizon: FloatArray, horizon_covariance: FloatArray
) -> bool:
    # The difference of a number from itself is 0, or NaN if the number is not finite.
    total = 0.0
    for value in x:
        total += value - value
    for value in covariance.ravel():
        total += value - value
    for value in horizon.ravel():
        total += value - value
    for value in horizon_covariance.ravel():
        total += value - value
    return total == 0.0
