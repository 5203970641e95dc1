# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames and covariances that contradict the conventions are reported."""

import math
from typing import Any

import numpy as np
import pytest

from adk_ros.bags import message
from adk_ros.signals.channels import Source
from adk_ros.signals.frames import published_frame
from adk_ros.signals.message_checks import message_warnings


def odometry(child: str = "base_link", parent: str = "odom", **variances: float) -> Any:
    covariance = np.zeros(36)
    for name, value in variances.items():
        covariance[{"v_x": 0, "v_y": 7, "yaw_rate": 35}[name]] = value
    return message(
        "nav_msgs/msg/Odometry",
        header={"stamp": 1, "frame_id": parent},
        child_frame_id=child,
        twist={"covariance": covariance},
    )


def imu(frame: str = "imu_link", force: float = 0.0, rate: float = 0.0) -> Any:
    return message(
        "sensor_msgs/msg/Imu",
        header={"stamp": 1, "frame_id": frame},
        linear_acceleration_covariance=np.array([force] + [0.0] * 8),
        angular_velocity_covariance=np.array([0.0] * 8 + [rate]),
    )


def test_conventional_messages_are_right() -> None:
    assert message_warnings(Source.ODOMETRY, odometry(), "base_link") == []
    assert message_warnings(Source.ODOMETRY, odometry(""), "base_link") == []
    assert message_warnings(Source.ODOMETRY, odometry(v_x=0.1, v_y=2.0), "") == []
    assert message_warnings(Source.IMU, imu(force=0.1, rate=1e-6)) == []
    assert message_warnings(Source.COMMAND, object()) == []


@pytest.mark.parametrize("child", ["odom", "map", "car1/odom", "world"])
def test_a_fixed_child_frame_is_reported(child: str) -> None:
    (text,) = message_warnings(Source.ODOMETRY, odometry(child), "base_link")
    assert text.startswith(f"odometry's child_frame_id is '{child}': the twist must be")


def test_the_frame_of_odometry_is_compared_with_that_of_the_predictions() -> None:
    (text,) = message_warnings(Source.ODOMETRY, odometry("base_footprint"), "base_link")
    assert text.endswith("but predictions are published in 'base_link': set frame_id")
    shifted = message_warnings(Source.ODOMETRY, odometry(), "centre_of_gravity", is_shifted=True)
    assert shifted == []
    (text,) = message_warnings(Source.ODOMETRY, odometry(), "base_link", is_shifted=True)
    assert text.startswith("predictions are of the reference point, but labelled 'base_link'")
    (text,) = message_warnings(Source.ODOMETRY, odometry(""), "base_link", is_shifted=True)
    assert text.startswith("predictions are of the reference point, but labelled 'base_link'")


def test_an_imu_in_a_fixed_frame_is_reported() -> None:
    (text,) = message_warnings(Source.IMU, imu("odom"))
    assert text.startswith("the IMU's frame_id is 'odom'")


@pytest.mark.parametrize("value", [-0.5, math.nan, math.inf, -math.inf])
def test_impossible_variances_are_reported(value: float) -> None:
    (text,) = message_warnings(Source.ODOMETRY, odometry(v_y=value))
    assert text == "odometry's variance of v_y is negative or not finite: ignored"
    (text,) = message_warnings(Source.IMU, imu(rate=value))
    assert text == "the IMU's variance of yaw rate is negative or not finite: ignored"


def test_huge_and_unavailable_are_reported() -> None:
    (text,) = message_warnings(Source.ODOMETRY, odometry(yaw_rate=1e6))
    assert text.startswith("odometry's variance of yaw rate is above 10000, which marks it as not")
    (text,) = message_warnings(Source.ODOMETRY, odometry(v_x=-1.0))
    assert text == "odometry marks its twist as not available (covariance -1)"
    (text,) = message_warnings(Source.IMU, imu(force=-1.0))
    assert text == "the IMU marks its acceleration as not available (covariance -1)"


@pytest.mark.parametrize(
    ("frame_id", "point", "published"),
    [
        ("", (0.0, 0.0), "base_link"),
        ("", (1.4, 0.0), "centre_of_gravity"),
        ("cog", (1.4, 0.0), "cog"),
        ("car1/base_link", (0.0, 0.0), "car1/base_link"),
    ],
)
def test_the_label_is_that_of_the_point(
    frame_id: str, point: tuple[float, float], published: str
) -> None:
    assert published_frame(frame_id, point) == published
