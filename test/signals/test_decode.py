# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decoding: equal for rclpy, rosbags and duck-typed messages; all refusals."""

import math
import re
from collections.abc import Callable
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adk_ros.errors import UsageError
from adk_ros.signals.channels import STANDARD_SOURCES, Reading, Source
from adk_ros.signals.commands import COMMAND_TYPES
from adk_ros.signals.decode import Decoder, RefusedMessage, SensorConfig
from adk_ros.signals.frames import rotation

STAMP_NS = 1_700_000_000_123_456_789
CAR: dict[str, Any] = {"mass": 2000.0, "wheel_radius": 0.3}


def header(stamp_ns: int = STAMP_NS) -> Message:
    return Message(stamp=Message(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9), frame_id="")


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Message:
    return Message(x=x, y=y, z=z)


def imu(force: Any = (1.0, 2.0, 9.8), rate: Any = (0.0, 0.0, 0.3), **fields: Any) -> Message:
    unknown = {
        "linear_acceleration_covariance": [0.0] * 9, "angular_velocity_covariance": [0.0] * 9
    }  # fmt: skip
    return Message(
        header=header(), linear_acceleration=vector(*force), angular_velocity=vector(*rate),
        **unknown | fields,
    )  # fmt: skip


def odometry(v_x: float = 20.0, v_y: float = 0.1, rate: float = 0.3) -> Message:
    twist = Message(linear=vector(v_x, v_y), angular=vector(0.0, 0.0, rate))
    return Message(header=header(), twist=Message(twist=twist, covariance=[0.0] * 36))


def joints(**fields: Any) -> Message:
    given = {"name": ["drive", "steer"], "position": [0.0, 0.05], "effort": [300.0, 0.0]}
    return Message(header=header(), **given | {"velocity": []} | fields)


MAKERS: dict[Source, Callable[[], Message]] = {
    Source.IMU: imu, Source.ODOMETRY: odometry, Source.COMMAND: joints
}  # fmt: skip


def ackermann(acceleration: float = 1.5, steering_angle: float = 0.04) -> Message:
    drive = Message(acceleration=acceleration, steering_angle=steering_angle, speed=10.0)
    return Message(header=header(), drive=drive)


def control(acceleration: float = 1.5, angle: float = 0.04) -> Message:
    """An Autoware command: its stamp is a top-level field."""
    return Message(
        stamp=header().stamp,
        lateral=Message(steering_tire_angle=angle),
        longitudinal=Message(acceleration=acceleration, velocity=10.0),
    )


def test_valid_messages() -> None:
    decoder = Decoder()
    assert decoder.decode(Source.IMU, imu()) == Reading(Source.IMU, STAMP_NS, (1.0, 2.0, 0.3))
    assert decoder.decode(Source.ODOMETRY, odometry()).values == (20.0, 0.1, 0.3)
    assert decoder.decode(Source.COMMAND, joints()).values == (300.0, 0.05)
    assert not decoder.refused


def test_rclpy_rosbags_and_duck_typed_messages_are_equal() -> None:
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import Imu, JointState

    from adk_ros.bags import message

    stamp = {"stamp": STAMP_NS, "frame_id": "base_link"}
    stored = {
        Source.IMU: message(
            "sensor_msgs/msg/Imu", header=stamp,
            linear_acceleration={"x": 1.0, "y": 2.0, "z": 9.8}, angular_velocity={"z": 0.3},
        ),
        Source.ODOMETRY: message(
            "nav_msgs/msg/Odometry", header=stamp,
            twist={"twist": {"linear": {"x": 20.0, "y": 0.1}, "angular": {"z": 0.3}}},
        ),
        Source.COMMAND: message(
            "sensor_msgs/msg/JointState", header=stamp, name=["drive", "steer"],
            position=[0.0, 0.05], effort=[300.0, 0.0],
        ),
    }  # fmt: skip
    live: dict[Source, Any] = {
        Source.IMU: Imu(), Source.ODOMETRY: Odometry(), Source.COMMAND: JointState()
    }  # fmt: skip
    for msg in live.values():
        msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(STAMP_NS, 10**9)
    live[Source.IMU].linear_acceleration.x, live[Source.IMU].linear_acceleration.y = 1.0, 2.0
    live[Source.IMU].angular_velocity.z = 0.3
    twist = live[Source.ODOMETRY].twist.twist
    twist.linear.x, twist.linear.y, twist.angular.z = 20.0, 0.1, 0.3
    live[Source.COMMAND].name = ["drive", "steer"]
    live[Source.COMMAND].position, live[Source.COMMAND].effort = [0.0, 0.05], [300.0, 0.0]
    duck_typed = {Source.IMU: imu(), Source.ODOMETRY: odometry(), Source.COMMAND: joints()}
    for source in stored:
        readings = [Decoder().decode(source, kind[source]) for kind in (stored, live, duck_typed)]
        assert readings[0] == readings[1] == readings[2]
        # The kernels are compiled for Python floats.
        assert {type(value) for value in readings[0].values} == {float}
        assert type(readings[0].stamp_ns) is int


def stamped(sec: int) -> Message:
    msg = imu()
    msg.header = header(sec * 10**9)
    return msg


@pytest.mark.parametrize("sec", [2**31 - 10, 2**31 - 1, 2**31, 2**32 - 1, 2**40])
def test_stamps_beyond_ros_time_are_refused(sec: int) -> None:
    decoder = Decoder()
    with pytest.raises(RefusedMessage, match="beyond the range of ROS time"):
        decoder.decode(Source.IMU, stamped(sec))
    assert decoder.decode(Source.IMU, stamped(2**31 - 11)).stamp_ns == (2**31 - 11) * 10**9


NUMBERS = (math.nan, math.inf, -math.inf, 1e9)
YAW, FORCE, SPEED = (
    "yaw rate is not",
    "acceleration is not",
    "velocity is not finite or above 150 m/s",
)
TORQUE, ANGLE = "drive torque is not finite or above", "steering angle is not finite or beyond"


@pytest.mark.parametrize("bad", NUMBERS)
@pytest.mark.parametrize(
    ("source", "make", "reason"),
    [
        (Source.IMU, lambda bad: imu(force=(bad, 0.0, 9.8)), FORCE),
        (Source.IMU, lambda bad: imu(force=(0.0, bad, 9.8)), FORCE),
        (Source.IMU, lambda bad: imu(rate=(0.0, 0.0, bad)), YAW),
        (Source.ODOMETRY, lambda bad: odometry(v_x=bad), SPEED),
        (Source.ODOMETRY, lambda bad: odometry(v_y=bad), SPEED),
        (Source.ODOMETRY, lambda bad: odometry(rate=bad), YAW),
        (Source.COMMAND, lambda bad: joints(effort=[bad, 0.0]), TORQUE),
        (Source.COMMAND, lambda bad: joints(position=[0.0, bad]), ANGLE),
    ],
)
def test_values_that_are_not_finite_or_out_of_range(
    source: Source, make: Any, reason: str, bad: float
) -> None:
    decoder = Decoder()
    for _ in range(3):
        with pytest.raises(RefusedMessage, match=reason):
            decoder.decode(source, make(bad))
    ((counted, text),) = decoder.refused
    assert (counted, decoder.refused[counted, text]) == (source, 3)
    assert text.startswith(reason)


@pytest.mark.parametrize("bad", NUMBERS)
def test_inferred_torque_out_of_range(bad: float) -> None:
    for kind, make in (("ackermann", ackermann), ("autoware_control", control)):
        decoder = Decoder(SensorConfig(command_type=kind, **CAR))
        with pytest.raises(RefusedMessage, match=TORQUE):
            decoder.decode(Source.COMMAND, make(bad, 0.0))
        with pytest.raises(RefusedMessage, match=ANGLE):
            decoder.decode(Source.COMMAND, make(0.0, bad))


def test_unused_fields_are_ignored() -> None:
    decoder = Decoder()
    assert decoder.decode(Source.IMU, imu(rate=(math.nan, math.nan, 0.3))).values[2] == 0.3
    assert decoder.decode(Source.IMU, imu(force=(1.0, 2.0, math.nan))).values[:2] == (1.0, 2.0)
    msg = odometry()
    msg.twist.twist.linear.z = math.nan
    assert decoder.decode(Source.ODOMETRY, msg).values == (20.0, 0.1, 0.3)


@pytest.mark.parametrize("stamp_ns", [0, -1, -5_000_000_000])
@pytest.mark.parametrize("source", STANDARD_SOURCES)
def test_missing_stamp(source: Source, stamp_ns: int) -> None:
    msg = MAKERS[source]()
    msg.header.stamp = Message(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    with pytest.raises(RefusedMessage, match=r"^no time stamp$"):
        Decoder().decode(source, msg)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"name": ["steer"], "position": [0.05], "effort": [0.0]}, "joint 'drive' is missing"),
        ({"name": ["drive"]}, "joint 'steer' is missing"),
        ({"name": []}, "joint 'drive' is missing"),
        ({"effort": []}, "joint 'drive' has no effort"),
        ({"name": ["steer", "drive"], "effort": [1.0], "position": [0.1, 0.0]}, "no effort"),
        ({"position": []}, "joint 'steer' has no position"),
        ({"position": [0.0]}, "joint 'steer' has no position"),
    ],
)
def test_missing_joint_or_field(fields: dict[str, Any], reason: str) -> None:
    decoder = Decoder()
    with pytest.raises(RefusedMessage, match=reason):
        decoder.decode(Source.COMMAND, joints(**fields))
    assert sum(decoder.refused.values()) == 1


def test_joints_by_name_and_ratio() -> None:
    config = SensorConfig(drive_joints=("rl", "rr"), steer_joint="wheel", steering_ratio=-16.0)
    msg = joints(
        name=["other", "rr", "wheel", "rl"], position=np.array([9.0, 9.0, 1.6, 9.0]),
        effort=np.array([9.0, 100.0, 9.0, 150.0]),
    )  # fmt: skip
    assert Decoder(config).decode(Source.COMMAND, msg).values == pytest.approx((250.0, -0.1))


def test_range_check_applies_to_the_road_wheel_angle() -> None:
    msg = joints(position=[0.0, 8.0])
    decoder = Decoder(SensorConfig(steering_ratio=16.0))
    assert decoder.decode(Source.COMMAND, msg).values[1] == 0.5
    with pytest.raises(RefusedMessage, match=ANGLE):
        Decoder().decode(Source.COMMAND, msg)


def test_inferred_torque() -> None:
    """Mass times acceleration times wheel radius; the angle is the road-wheel angle."""
    for kind, make in (("ackermann", ackermann), ("autoware_control", control)):
        decoder = Decoder(SensorConfig(command_type=kind, steering_ratio=16.0, **CAR))
        reading = decoder.decode(Source.COMMAND, make())
        values: Any = (pytest.approx(900.0), 0.04)
        assert reading == Reading(Source.COMMAND, STAMP_NS, values)


def test_command_types() -> None:
    assert {kind: row.msgtype for kind, row in COMMAND_TYPES.items()} == {
        "joint_state": "sensor_msgs/msg/JointState",
        "ackermann": "ackermann_msgs/msg/AckermannDriveStamped",
        "autoware_control": "autoware_control_msgs/msg/Control",
    }
    assert {kind for kind, row in COMMAND_TYPES.items() if row.inferred_torque} == {
        "ackermann", "autoware_control"
    }  # fmt: skip


@pytest.mark.parametrize("source", STANDARD_SOURCES)
@pytest.mark.parametrize(
    "msg",
    [
        None, 3, "text", b"", {}, Message(), Message(header=None), Message(header=Message()),
        Message(header=header()), Message(header=header(), twist=None, name=None),
        Message(header=Message(stamp=Message(sec="now", nanosec=0))),
        Message(header=Message(stamp=Message(sec=math.nan, nanosec=0))),
        Message(header=Message(stamp=Message(sec=math.inf, nanosec=0))),
        imu(force=("a", "b", "c")), imu(angular_velocity_covariance=[]), imu(rate=(0, 0, 10**400)),
        joints(effort=None), joints(effort=["x", "y"]), joints(position=[0.0, 10**400]),
    ],
    ids=repr,
)  # fmt: skip
def test_objects_of_another_type(source: Source, msg: Any) -> None:
    """Each object is refused without a traceback."""
    decoder = Decoder()
    if isinstance(msg, Message) and hasattr(msg, "linear_acceleration"):
        source = Source.IMU
    if isinstance(msg, Message) and hasattr(msg, "effort"):
        source = Source.COMMAND
    with pytest.raises(RefusedMessage, match="not the expected message type"):
        decoder.decode(source, msg)
    assert decoder.refused.total() == 1


@pytest.mark.parametrize("expected", STANDARD_SOURCES)
def test_messages_of_the_other_sources(expected: Source) -> None:
    for source, make in MAKERS.items():
        if source is not expected:
            with pytest.raises(RefusedMessage, match="not the expected message type"):
                Decoder().decode(expected, make())


def test_rep_145_fields_that_are_not_reported() -> None:
    missing = [-1.0] + [0.0] * 8
    decoder = Decoder(SensorConfig(imu_position=(1.0, 0.0)))
    values = decoder.decode(Source.IMU, imu(linear_acceleration_covariance=missing)).values
    assert values[2] == 0.3
    assert math.isnan(values[0])
    assert math.isnan(values[1])
    with pytest.raises(RefusedMessage, match="reports no angular velocity"):
        decoder.decode(Source.IMU, imu(angular_velocity_covariance=missing))


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3.1, 3.1))
def test_rotated_imu(roll: float, pitch: float, yaw: float) -> None:
    turn = rotation(roll, pitch, yaw)
    body_force, body_rate = np.array([1.0, -2.0, 9.8]), np.array([0.01, -0.02, 0.4])
    decoder = Decoder(SensorConfig(imu_rotation=(roll, pitch, yaw)))
    values = decoder.decode(Source.IMU, imu(turn.T @ body_force, turn.T @ body_rate)).values
    assert values == pytest.approx((1.0, -2.0, 0.4), abs=1e-12)


def test_upside_down_imu() -> None:
    """With z down, y and the yaw rate change sign."""
    decoder = Decoder(SensorConfig(imu_rotation=(math.pi, 0.0, 0.0)))
    msg = imu((1.0, 2.0, -9.8), (0.0, 0.0, -0.3))
    assert decoder.decode(Source.IMU, msg).values == pytest.approx((1.0, -2.0, 0.3))


@given(st.floats(-40, 40), st.floats(-3, 3), st.floats(-2, 2), st.floats(0, 3))
def test_reference_point(v_x: float, v_y: float, rate: float, l_r: float) -> None:
    decoder = Decoder(SensorConfig(reference_point=(l_r, 0.0)))
    values = decoder.decode(Source.ODOMETRY, odometry(v_x, v_y, rate)).values
    assert values == pytest.approx((v_x, v_y + l_r * rate, rate))


def test_imu_off_the_reference_point() -> None:
    """The lever arm is relative to the centre of gravity, not to base_link."""
    config = SensorConfig(reference_point=(1.4, 0.0), imu_position=(2.0, 0.1))
    decoder = Decoder(config)
    for k in range(3):
        msg = imu((1.0 - 0.25 * 0.6, 2.0 - 0.25 * 0.1, 9.8), (0.0, 0.0, 0.5))
        msg.header = header(STAMP_NS + 5_000_000 * k)
        assert decoder.decode(Source.IMU, msg).values == pytest.approx((1.0, 2.0, 0.5))
    at_reference = SensorConfig(reference_point=(1.4, 0.2), imu_position=(1.4, 0.2))
    assert Decoder(at_reference).decode(Source.IMU, imu()).values == (1.0, 2.0, 0.3)


def test_known_errors_are_removed() -> None:
    config = SensorConfig(
        imu_position=(1.0, 0.0),
        accelerometer_scale=0.1,
        accelerometer_bias=(0.02, -0.03),
        gyro_scale=2.0,
        gyro_bias=0.1,
        odometry_scale=3.6,
        odometry_rotation=0.1,
        yaw_rate_scale=-1.0,
        yaw_rate_bias=0.05,
        torque_scale=1e-3,
        steering_offset=0.02,
        imu_delay=0.04,
        odometry_delay=0.1,
        command_delay=0.01,
    )
    decoder = Decoder(config)
    rate = 0.5
    force = (0.1 * (1.0 - rate * rate) + 0.02, 0.1 * 2.0 - 0.03, 0.98)
    reading = decoder.decode(Source.IMU, imu(force, (0.0, 0.0, 2.0 * rate + 0.1)))
    # The lever arm of 1 m has the centripetal acceleration of the corrected yaw rate.
    assert reading.values == pytest.approx((1.0, 2.0, rate))
    assert reading.stamp_ns == STAMP_NS - 40_000_000
    # Axes that are turned to the left see the velocity further to the right.
    speed, left = math.hypot(10.0, 0.1), math.atan2(0.1, 10.0) - 0.1
    turned = (3.6 * speed * math.cos(left), 3.6 * speed * math.sin(left))
    reading = decoder.decode(Source.ODOMETRY, odometry(*turned, -0.25))
    assert reading.values == pytest.approx((10.0, 0.1, 0.3))
    assert reading.stamp_ns == STAMP_NS - 100_000_000
    reading = decoder.decode(
        Source.COMMAND, joints(name=["drive", "steer"], effort=[0.4, 0.0], position=[0.0, 0.12])
    )
    assert reading.values == pytest.approx((400.0, 0.1))
    assert reading.stamp_ns == STAMP_NS - 10_000_000


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"gyro_scale": 0.0}, "gyro_scale is 0"),
        ({"odometry_delay": 2.0}, "odometry_delay is 2 s: give 0 to 1 s"),
        ({"imu_delay": -0.1}, "imu_delay is -0.1 s"),
        ({"accelerometer_bias": (0.0, math.nan)}, "accelerometer_bias is not finite"),
        (
            {"odometry_type": "ground_velocity", "odometry_rotation": 0.1},
            "odometry_type 'ground_velocity' has no v_y: set no odometry_rotation",
        ),
    ],
)
def test_impossible_errors_are_refused(fields: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=re.escape(said)):
        SensorConfig(**fields)


def test_reset_discards_the_gyro_history() -> None:
    decoder = Decoder(SensorConfig(imu_position=(1.0, 0.0)))
    fresh = Decoder(SensorConfig(imu_position=(1.0, 0.0)))
    decoder.decode(Source.IMU, imu(rate=(0.0, 0.0, 0.0)))
    decoder.reset()
    later = imu()
    later.header = header(STAMP_NS + 5_000_000)
    assert decoder.decode(Source.IMU, later) == fresh.decode(Source.IMU, later)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"command_type": "twist"}, "command_type 'twist' is unknown: choose one of joint_state"),
        ({"command_type": "ackermann"}, "carries an acceleration: set mass and wheel_radius"),
        ({"command_type": "ackermann", "mass": 2000.0}, "set mass and wheel_radius"),
        ({"command_type": "autoware_control", "wheel_radius": 0.3}, "set mass and wheel_radius"),
        ({"command_type": "ackermann", "mass": -1.0, "wheel_radius": 0.3}, "set mass"),
        ({"steering_ratio": 0.0}, "steering_ratio is 0"),
        ({"steering_ratio": math.nan}, "not finite"),
        ({"reference_point": (math.inf, 0.0)}, "not finite"),
        ({"imu_position": (0.0, math.nan)}, "not finite"),
        ({"imu_rotation": (0.0, 0.0, -math.inf)}, "not finite"),
        ({"mass": math.nan}, "not finite"),
        ({"drive_joints": ()}, "drive_joints is empty"),
        ({"drive_joints": ("a", "a")}, "names a joint twice"),
    ],
)
def test_invalid_configurations_are_refused(fields: dict[str, Any], reason: str) -> None:
    with pytest.raises(UsageError, match=reason):
        SensorConfig(**fields)
