# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Withhold the attitude of an inertial navigation system, and require the slope of the road.

The profile of grade and bank comes from specific force, velocity and yaw rate; the attitude, which
a navigation system computes from the same IMU and a receiver, is the reference. What each is worth
is the error of v_x after 1 s, integrated from specific force: without a slope, with the profile of
the data before and after that second, and with the attitude.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from adk_ros.calibration.check import check, correct_signs
from adk_ros.calibration.criteria import MATERIAL
from adk_ros.calibration.from_bag import BagContent
from adk_ros.calibration.road import attitude_comparison, recorded_drive
from adk_ros.calibration.stream_checks import check_streams
from adk_ros.road.open_loop import held_out_speed_error, speed_error
from adk_ros.road.recorded_drive import RecordedDrive
from adk_ros.signals.moving_speed import STANDING_SPEED

MAX_LEFT = 0.2
"""Share of the error of v_x 1 s ahead that a grade leaves where the slope dominates it."""


@dataclass(frozen=True)
class SlopeOutcome:
    """
    A slope without the attitude, compared with it.

    `slope`: "grade" or "bank"; `correlation` and `scale` over the attitude's; `spread`: RMS of
    the attitude, rad; `is_counted`: whether it changes by a material size. `v_x_error`: RMS error
    of v_x after 1 s, m/s, without a slope, with the attitude withheld, and with it used; empty for
    the bank.
    """

    vehicle: str
    recording: str
    slope: str
    correlation: float
    scale: float
    spread: float
    is_counted: bool
    v_x_error: tuple[float, ...] = ()

    @property
    def is_dominated(self) -> bool:
        """Whether the slope makes most of the error of v_x: the attitude removes that much."""
        if not self.v_x_error:
            return False
        none, _, used = self.v_x_error
        return used <= MAX_LEFT * none

    def as_dict(self) -> dict[str, object]:
        """Return the outcome for JSON."""
        return asdict(self)


def slope_outcomes(vehicle: str, recording: str, content: BagContent) -> list[SlopeOutcome]:
    """Return the slopes of a recording that has an attitude; none without."""
    attitude = content.streams.attitude
    if attitude is None:
        return []
    withheld = replace(content, streams=replace(content.streams, attitude=None))
    profile = check(withheld).road
    if profile is None:
        return []
    drive = _checked_drive(withheld)
    angles = -np.interp(profile.at_s, attitude.at_s, attitude["pitch"])
    none, found = held_out_speed_error(drive, profile.grade_variances, STANDING_SPEED)
    _, used = speed_error(drive, profile.at_s, angles, STANDING_SPEED)
    return [
        SlopeOutcome(
            vehicle,
            recording,
            name,
            correlation,
            scale,
            spread,
            spread >= MATERIAL[f"road_{name}"].size,
            (none, found, used) if name == "grade" else (),
        )
        for name, correlation, scale, spread in attitude_comparison(profile, attitude)
    ]


def _checked_drive(content: BagContent) -> RecordedDrive:
    """Return the drive with the signs, axes and units that `check` corrects before the profile."""
    streams, _, _ = correct_signs(content, check_streams(content.streams).unusable, None)
    # Gaps of the command do not matter to the road.
    unusable = check_streams(replace(content.streams, command=None)).unusable
    return recorded_drive(streams, unusable)
