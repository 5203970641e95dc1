# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Withhold the attitude of an inertial navigation system, and require the slope of the road.

The profile of grade and bank comes from specific force, velocity and yaw rate; the attitude, which
a navigation system computes from the same IMU and a receiver, is the reference.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

from adk_ros.calibration.check import check
from adk_ros.calibration.criteria import MATERIAL
from adk_ros.calibration.from_bag import BagContent
from adk_ros.calibration.road import attitude_comparison


@dataclass(frozen=True)
class SlopeOutcome:
    """
    A slope without the attitude, compared with it.

    `slope`: "grade" or "bank"; `correlation` and `scale` over the attitude's; `spread`: RMS of
    the attitude, rad; `is_counted`: whether it changes by a material size.
    """

    vehicle: str
    recording: str
    slope: str
    correlation: float
    scale: float
    spread: float
    is_counted: bool

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
    return [
        SlopeOutcome(
            vehicle,
            recording,
            name,
            correlation,
            scale,
            spread,
            spread >= MATERIAL[f"road_{name}"].size,
        )
        for name, correlation, scale, spread in attitude_comparison(profile, attitude)
    ]
