# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What compensating the grade is worth: kinematic prediction of v_x without torque or model."""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.road.recorded_drive import RecordedDrive, in_steps

_EVERY_S = 0.5
"""s from one start to the next: about the correlation time of the errors."""


def speed_error(
    drive: RecordedDrive,
    at_s: FloatArray,
    grade: FloatArray,
    standing_speed: float,
    horizon_s: float = 1.0,
) -> tuple[float, float]:
    """
    Return the RMS error of v_x, m/s, after a horizon without and with the grade; NaN without data.

    v_x(t + T) = v_x(t) + integral of (a_x + r v_y - g sin(grade)).

    :param at_s: stamps (n,) of the grade (n,), rad; starts without a grade around them are left
        out.
    """
    steps = in_steps(drive, standing_speed)
    if steps is None:
        return float("nan"), float("nan")
    count = max(round(horizon_s / steps.step_s), 1)
    gravity = steps.step_s * np.interp(steps.at_s, at_s, GRAVITY * np.sin(grade))
    force = steps.force_x + steps.turn_x
    is_used = np.concatenate([[0], np.cumsum(~steps.used)])
    starts = np.arange(0, force.size - count, max(round(_EVERY_S / steps.step_s), 1))
    starts = starts[is_used[starts + count] == is_used[starts]]
    if starts.size == 0:
        return float("nan"), float("nan")

    def over(values: FloatArray) -> FloatArray:
        total = np.concatenate([[0.0], np.cumsum(values)])
        return np.asarray(total[starts + count] - total[starts])

    gained = steps.v_x[starts + count] - steps.v_x[starts]
    without = over(force) - gained
    compensated = without - over(0.5 * (gravity[1:] + gravity[:-1]))
    return float(np.sqrt(np.mean(without**2))), float(np.sqrt(np.mean(compensated**2)))
