# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What compensating the grade is worth: kinematic prediction of v_x without torque or model.

v_x(t + T) = v_x(t) + integral of (a_x + r v_y - g sin(grade)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.road.profile import road_grade
from adk_ros.road.recorded_drive import RecordedDrive, Steps, in_steps
from adk_ros.road.smoother import Variances

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

    The grade must be independent of a_x and v_x, which it is to explain.

    :param at_s: stamps (n,) of the grade (n,), rad.
    """
    steps = in_steps(drive, standing_speed)
    if steps is None:
        return float("nan"), float("nan")
    windows = _Windows.of(steps, horizon_s)
    starts = np.arange(0, steps.force_x.size - windows.count, windows.in_steps(_EVERY_S))
    return _rms(windows.errors(starts, at_s, grade))


def held_out_speed_error(
    drive: RecordedDrive, variances: Variances, standing_speed: float, horizon_s: float = 1.0
) -> tuple[float, float]:
    """
    Return the RMS error of v_x, m/s, after a horizon without and with the grade of the profile.

    The profile comes from a_x and v_x. So every other horizon is left out of one profile, and the
    ones between out of another: each is predicted by the profile that has not seen it, from the
    road before and after. NaN without data.

    :param variances: of the grade, `RoadProfile.grade_variances` of the whole drive.
    """
    steps = in_steps(drive, standing_speed)
    if steps is None:
        return float("nan"), float("nan")
    windows = _Windows.of(steps, horizon_s)
    return _rms(np.concatenate([np.empty((2, 0)), *_held_out(drive, variances, windows)], axis=1))


def _held_out(
    drive: RecordedDrive, variances: Variances, windows: _Windows
) -> Iterator[FloatArray]:
    """Yield the errors (2, k) of each half of the horizons."""
    at, count = windows.steps.at_s, windows.count
    for first in (0, count):
        starts = np.arange(first, at.size - count, 2 * count)
        left_out = tuple(zip(at[starts].tolist(), at[starts + count].tolist(), strict=True))
        rest = replace(drive, unusable=(*drive.unusable, *left_out))
        grade = road_grade(rest, variances)
        if grade is not None:
            yield windows.errors(starts, *grade)


@dataclass(frozen=True)
class _Windows:
    """Horizons of `count` steps."""

    steps: Steps
    count: int

    @staticmethod
    def of(steps: Steps, horizon_s: float) -> _Windows:
        return _Windows(steps, max(round(horizon_s / steps.step_s), 1))

    def in_steps(self, seconds: float) -> int:
        return max(round(seconds / self.steps.step_s), 1)

    def errors(self, starts: IntArray, at_s: FloatArray, grade: FloatArray) -> FloatArray:
        """Return the errors (2, k) at the end without and with a grade, from usable starts."""
        steps = self.steps
        is_unused = np.concatenate([[0], np.cumsum(~steps.used)])
        starts = starts[is_unused[starts + self.count] == is_unused[starts]]

        def over(values: FloatArray) -> FloatArray:
            total = np.concatenate([[0.0], np.cumsum(values)])
            return np.asarray(total[starts + self.count] - total[starts])

        gravity = steps.step_s * np.interp(steps.at_s, at_s, GRAVITY * np.sin(grade))
        gained = steps.v_x[starts + self.count] - steps.v_x[starts]
        without = over(steps.force_x + steps.turn_x) - gained
        return np.array([without, without - over(0.5 * (gravity[1:] + gravity[:-1]))])


def _rms(errors: FloatArray) -> tuple[float, float]:
    if not errors.size:
        return float("nan"), float("nan")
    without, compensated = np.sqrt(np.mean(errors**2, axis=1)).tolist()
    return without, compensated
