# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives without a fault have no finding, whatever the seed, the road and the car."""

from __future__ import annotations

import pytest
from helpers.calibration import checked, driven

from adk_ros.calibration.finding import Verdict


@pytest.mark.parametrize(
    ("scenario", "seed"),
    [("handling", 1), ("handling", 2), ("handling", 3), ("town", 2), ("mountain", 2)],
)
def test_a_clean_drive_has_no_finding(scenario: str, seed: int) -> None:
    result = checked(driven(scenario, seed))
    assert [x.text for x in result.of(Verdict.FINDING)] == []
    assert result.parameters == {}
    assert result.advice.startswith("nothing to correct")


def test_a_clean_drive_is_decided() -> None:
    decided = {x.name for x in checked(driven("town", 2)).of(Verdict.OK)}
    assert decided >= {
        "v_x", "v_y", "yaw_rate", "w_z", "steering", "torque", "gravity", "imu_axes",
        "odometry_scale", "gyro_scale", "gyro_bias", "gyro_delay", "accelerometer_delay",
        "imu_position", "a_x_offset", "reference_point", "steering_offset", "steering_delay",
    }  # fmt: skip


def test_a_slalom_has_no_false_scale() -> None:
    result = checked(driven("slalom", 31, 100.0))
    assert not result.of(Verdict.FINDING)
