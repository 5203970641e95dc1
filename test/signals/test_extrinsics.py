# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose of the IMU from fixed transforms: chains, rotations, and what is no transform."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from adk_ros.bags import message
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.extrinsics import (
    StaticTransforms,
    extrinsics_text,
    frame_of,
    roll_pitch_yaw,
    with_extrinsics,
)
from adk_ros.signals.frames import odometry_covariance, odometry_velocity, rotation

ANGLES = [
    (0.0, 0.0, 0.0),
    (math.pi, 0.0, 0.0),
    (0.1, -0.2, 3.0),
    (-1.0, 1.2, -2.0),
    (0.0, math.pi / 2, 0.7),
    (0.0, -math.pi / 2, -0.7),
]


def transform(
    parent: str,
    child: str,
    position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> dict[str, Any]:
    x, y, z, w = Rotation.from_euler("xyz", angles).as_quat()
    px, py, pz = position
    return {
        "header": {"frame_id": parent},
        "child_frame_id": child,
        "transform": {
            "translation": {"x": px, "y": py, "z": pz},
            "rotation": {"x": x, "y": y, "z": z, "w": w},
        },
    }


def transforms(*entries: dict[str, Any]) -> StaticTransforms:
    out = StaticTransforms()
    items = []
    for entry in entries:
        inner = entry["transform"]
        items.append(
            message(
                "geometry_msgs/msg/TransformStamped",
                header=entry["header"],
                child_frame_id=entry["child_frame_id"],
                transform=inner,
            )
        )
    out.add(message("tf2_msgs/msg/TFMessage", transforms=items))
    return out


@pytest.mark.parametrize("angles", ANGLES)
def test_angles_are_those_of_the_decoder(angles: tuple[float, float, float]) -> None:
    matrix = rotation(*angles)
    assert rotation(*roll_pitch_yaw(matrix)) == pytest.approx(matrix, abs=1e-8)
    known = transforms(transform("base_link", "imu", (1.2, -0.3, 0.5), angles))
    pose = known.pose_of("imu", "base_link")
    assert pose is not None
    assert pose.rotation == pytest.approx(matrix, abs=1e-12)


def test_poses_add_up_along_the_tree_and_across_branches() -> None:
    known = transforms(
        transform("base_link", "plate", (1.0, 0.0, 0.3), (0.0, 0.0, math.pi / 2)),
        transform("plate", "imu", (0.5, 0.0, 0.0), (math.pi, 0.0, 0.0)),
        transform("base_link", "rear_axle", (-1.3, 0.0, 0.0)),
    )
    sensors = with_extrinsics(SensorConfig(), known, "base_link", "imu")
    assert sensors.imu_position == pytest.approx((1.0, 0.5))
    assert sensors.imu_rotation == pytest.approx((math.pi, 0.0, math.pi / 2))
    # Odometry of the rear axle.
    assert with_extrinsics(SensorConfig(), known, "rear_axle", "imu").imu_position == (
        pytest.approx((2.3, 0.5))
    )
    back = known.pose_of("base_link", "imu")
    assert back is not None
    there = known.pose_of("imu", "base_link")
    assert there is not None
    assert back.rotation @ there.position + back.position == pytest.approx(np.zeros(3), abs=1e-12)


def test_an_unrotated_imu_at_the_origin_changes_nothing() -> None:
    known = transforms(transform("base_link", "imu", (0.0, 0.0, 0.4)))
    assert with_extrinsics(SensorConfig(), known, "base_link", "imu") == SensorConfig()


@pytest.mark.parametrize(
    "sensors",
    [
        SensorConfig(imu_position=(0.1, 0.0)),
        SensorConfig(imu_rotation=(0.0, 0.0, 0.1)),
        SensorConfig(use_tf=False),
    ],
)
def test_parameters_override_the_transforms(sensors: SensorConfig) -> None:
    known = transforms(transform("base_link", "imu", (1.0, 2.0, 3.0)))
    assert with_extrinsics(sensors, known, "base_link", "imu") == sensors


def test_unconnected_and_unnamed_frames_are_not_known() -> None:
    known = transforms(
        transform("base_link", "imu", (1.0, 0.0, 0.0)),
        transform("other", "lidar", (3.0, 0.0, 0.0)),
    )
    for vehicle, imu in (("base_link", "lidar"), ("base_link", "gps"), ("", "imu"), ("imu", "")):
        assert with_extrinsics(SensorConfig(), known, vehicle, imu) == SensorConfig()
    assert with_extrinsics(SensorConfig(), known, "/base_link", "/imu").imu_position == (1.0, 0.0)


def test_loops_and_unusable_numbers_are_ignored() -> None:
    loop = transforms(transform("a", "b", (1.0, 0.0, 0.0)), transform("b", "a", (1.0, 0.0, 0.0)))
    assert loop.pose_of("a", "c") is None
    faulty = transform("base_link", "imu", (math.nan, 0.0, 0.0))
    assert transforms(faulty).pose_of("imu", "base_link") is None
    empty = transform("base_link", "imu")
    empty["transform"]["rotation"] = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}
    assert transforms(empty).pose_of("imu", "base_link") is None
    assert transforms(transform("imu", "imu")).pose_of("imu", "base_link") is None


def test_later_transforms_replace_earlier_ones() -> None:
    known = transforms(
        transform("base_link", "imu", (1.0, 0.0, 0.0)),
        transform("base_link", "imu", (2.0, 0.0, 0.0)),
    )
    assert with_extrinsics(SensorConfig(), known, "base_link", "imu").imu_position == (2.0, 0.0)


def test_the_frame_of_a_twist_is_the_child_frame() -> None:
    odometry = message(
        "nav_msgs/msg/Odometry", header={"frame_id": "odom"}, child_frame_id="base_link"
    )
    assert frame_of(odometry) == "base_link"
    assert frame_of(message("sensor_msgs/msg/Imu", header={"frame_id": "imu_link"})) == "imu_link"


def test_the_text_names_position_and_angles() -> None:
    sensors = SensorConfig(imu_position=(1.25, 0.0), imu_rotation=(math.pi, 0.0, 0.0))
    assert extrinsics_text(sensors) == (
        "IMU at (1.25, 0) m, rotated by (180, 0, 0)° (roll, pitch, yaw): /tf_static"
    )


def test_the_covariance_moves_with_the_velocities() -> None:
    """Of a twist at the rear axle, whose lateral velocity has the yaw rate's error times 1.4 m."""
    rng = np.random.default_rng(0)
    root = np.array([[0.1, 0.0, 0.0], [0.02, 0.05, 0.0], [0.0, 0.01, 0.05]])
    drawn = rng.normal(size=(200_000, 3)) @ root.T
    at_base = odometry_velocity(drawn, (1.4, 0.2), 1.2)
    found = odometry_covariance((root @ root.T)[None], (1.4, 0.2), 1.2)
    assert found.shape == (1, 3, 3)
    np.testing.assert_allclose(found[0], np.cov(at_base.T), rtol=0.03, atol=1e-4)
