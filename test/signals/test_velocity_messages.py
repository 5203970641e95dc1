# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""v_x from wheel speeds and GPS velocity in place of odometry, and an estimated v_y."""

import math

import numpy as np
import pytest

from adk_ros.bags import message
from adk_ros.errors import UsageError
from adk_ros.signals.channels import Source
from adk_ros.signals.decode import Decoder, RefusedMessage, SensorConfig
from adk_ros.signals.velocity_messages import estimated_lateral_velocity

WHEELS = SensorConfig(odometry_type="wheel_joints", wheel_radius=0.3)
RATE = 0.2


def odometry(v_y=0.0, variance=0.0):
    covariance = np.zeros(36)
    covariance[7] = variance
    twist = {"linear": {"x": 20.0, "y": v_y}, "angular": {"z": RATE}}
    return message(
        "nav_msgs/msg/Odometry",
        header={"stamp": 1, "frame_id": "odom"},
        twist={"twist": twist, "covariance": covariance},
    )


def joints(names, velocities):
    return message(
        "sensor_msgs/msg/JointState",
        header={"stamp": 1, "frame_id": ""},
        name=names,
        velocity=velocities,
    )


def twist(**content):
    header = {"stamp": 1, "frame_id": ""}
    return message("geometry_msgs/msg/TwistStamped", header=header, twist=content)


def gyro():
    return message(
        "sensor_msgs/msg/Imu",
        header={"stamp": 1, "frame_id": ""},
        angular_velocity={"z": RATE},
    )


def test_wheel_joints_give_v_x_and_the_gyro_the_yaw_rate():
    decoder = Decoder(WHEELS)
    decoder.decode(Source.IMU, gyro())
    msg = joints(["front_left", "rear_left", "rear_right"], [90.0, 50.0, 54.0])
    reading = decoder.decode(Source.ODOMETRY, msg)
    assert reading.values == pytest.approx((0.3 * 52.0, 0.0, RATE))
    assert reading.variances is None
    assert not decoder.measures_v_y


def test_without_a_recent_gyro_there_is_no_yaw_rate():
    """The IMU may die in a bend: its last value is no measurement of the straight after it."""
    decoder = Decoder(WHEELS)
    names, speeds = ["rear_left", "rear_right"], [50.0, 50.0]
    with pytest.raises(RefusedMessage, match=r"no yaw rate: no IMU message within 0\.2 s"):
        decoder.decode(Source.ODOMETRY, joints(names, speeds))
    decoder.decode(Source.IMU, gyro())
    later = joints(names, speeds)
    later.header.stamp.nanosec = 200_000_001
    assert decoder.decode(Source.ODOMETRY, later).values[2] == RATE
    later.header.stamp.nanosec += 1
    with pytest.raises(RefusedMessage, match="no yaw rate"):
        decoder.decode(Source.ODOMETRY, later)
    decoder.decode(Source.IMU, gyro())
    decoder.reset()
    with pytest.raises(RefusedMessage, match="no yaw rate"):
        decoder.decode(Source.ODOMETRY, joints(names, speeds))


def test_an_axle_and_a_receiver_give_v_x():
    axle = Decoder(SensorConfig(odometry_type="wheel_speed", wheel_radius=0.3))
    axle.decode(Source.IMU, gyro())
    assert axle.decode(Source.ODOMETRY, twist(angular={"y": 50.0})).values[0] == 15.0
    receiver = Decoder(SensorConfig(odometry_type="ground_velocity"))
    receiver.decode(Source.IMU, gyro())
    assert receiver.decode(Source.ODOMETRY, twist(linear={"x": -3.0, "y": 4.0})).values[0] == 5.0


@pytest.mark.parametrize(
    ("msg", "reason"),
    [
        (joints(["rear_left"], [1.0]), "joint 'rear_right' is missing"),
        (joints(["rear_left", "rear_right"], [1.0]), "joint 'rear_right' has no velocity"),
        (joints(["rear_left", "rear_right"], [1.0, math.nan]), "velocity is not finite"),
        (odometry(), "not the expected message type"),
    ],
)
def test_messages_without_wheel_speeds_are_refused(msg, reason):
    decoder = Decoder(WHEELS)
    decoder.decode(Source.IMU, gyro())
    with pytest.raises(RefusedMessage, match=reason):
        decoder.decode(Source.ODOMETRY, msg)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"odometry_type": "x"}, "odometry_type 'x' is unknown: choose one of odometry, wheel"),
        ({"odometry_type": "wheel_speed"}, "set wheel_radius"),
        (
            {"odometry_type": "wheel_joints", "wheel_radius": 0.3, "wheel_joints": ()},
            "name the joints",
        ),
        ({"sideslip": (math.nan, 0.0)}, "not finite"),
    ],
)
def test_a_configuration_that_gives_no_velocity_is_refused(arguments, text):
    with pytest.raises(UsageError, match=text):
        SensorConfig(**arguments)


def test_v_y_is_estimated_where_it_is_not_measured():
    decoder = Decoder(SensorConfig(sideslip=(1.5, 0.005)))
    values = decoder.decode(Source.ODOMETRY, odometry()).values
    # l r - kappa r v², and 1.5 m behind it the rear axle slips by kappa v r.
    assert values[1] == pytest.approx(1.5 * RATE - 0.005 * RATE * 400.0)
    assert (values[1] - 1.5 * RATE) / 20.0 == pytest.approx(-0.005 * 20.0 * RATE)
    assert not decoder.measures_v_y
    assert estimated_lateral_velocity(0.0, RATE, 1.5, 0.005) == 1.5 * RATE


def test_a_covariance_marks_v_y_as_not_measured():
    decoder = Decoder()
    assert decoder.decode(Source.ODOMETRY, odometry(0.3, 1e6)).values[1] == 0.3
    assert not decoder.measures_v_y
    decoder.decode(Source.ODOMETRY, odometry(0.3))
    assert decoder.measures_v_y
