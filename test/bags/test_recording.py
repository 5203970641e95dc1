# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Record and sensor log have the same content, whatever the command type."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.bags import ACKERMANN, START_NS, drive, write
from helpers.train import bag
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from adk_ros.bags import Bag, message
from adk_ros.bags.recording import RecordingOptions, choose_topics, read_recording
from adk_ros.errors import DataError
from adk_ros.mismatch.inference.observability import observable_effects
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.signals.decode import SensorConfig

CONTROL = "autoware_control_msgs/msg/Control"
STEERING = "autoware_vehicle_msgs/msg/SteeringReport"
DRIVE = "ackermann_msgs/msg/AckermannDriveStamped"
SEPARATOR = "\n" + "=" * 80 + "\n"
DEFINITIONS = {
    DRIVE: ACKERMANN,
    STEERING: "builtin_interfaces/Time stamp\nfloat32 steering_tire_angle\n",
    CONTROL: SEPARATOR.join(
        (
            "builtin_interfaces/Time stamp\nLateral lateral\nLongitudinal longitudinal",
            "MSG: autoware_control_msgs/Lateral\nfloat32 steering_tire_angle",
            "MSG: autoware_control_msgs/Longitudinal\nfloat32 acceleration",
        )
    ),
}
STORE = get_typestore(Stores.ROS2_JAZZY)
for definition_of, definition_text in DEFINITIONS.items():
    STORE.register(get_types_from_msg(definition_text, definition_of))
TYPES = STORE.types
MASS, WHEEL_RADIUS = 1200.0, 0.3
SECONDS = 4.0


def time_of(stamp_ns):
    return TYPES["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)


def control(stamp_ns, acceleration, angle):
    lateral = TYPES["autoware_control_msgs/msg/Lateral"](steering_tire_angle=angle)
    longitudinal = TYPES["autoware_control_msgs/msg/Longitudinal"](acceleration=acceleration)
    return TYPES[CONTROL](stamp=time_of(stamp_ns), lateral=lateral, longitudinal=longitudinal)


def ackermann(stamp_ns, acceleration, angle):
    drive = TYPES["ackermann_msgs/msg/AckermannDrive"](
        steering_angle=angle, steering_angle_velocity=0.0, speed=0.0,
        acceleration=acceleration, jerk=0.0,
    )  # fmt: skip
    return TYPES[DRIVE](header=message("std_msgs/msg/Header", stamp=stamp_ns), drive=drive)


def command_bag(path, make_command, steering_from_s=None):
    """A bag of IMU 100 Hz, odometry 50 Hz, commands 30 Hz and measured steering 70 Hz."""
    messages = []

    def add(rate_hz, topic, make, begin_s=0.0):
        for k in range(int((SECONDS - begin_s) * rate_hz)):
            time_s = begin_s + (k + 0.3) / rate_hz
            stamp_ns = START_NS + round(time_s * 1e9)
            messages.append((topic, stamp_ns, make(stamp_ns, time_s)))

    def imu(stamp_ns, time_s):
        return message("sensor_msgs/msg/Imu", header={"stamp": stamp_ns})

    def odometry(stamp_ns, time_s):
        twist = {"linear": {"x": 10.0 + time_s}, "angular": {"z": 0.1 * math.sin(time_s)}}
        return message("nav_msgs/msg/Odometry", header={"stamp": stamp_ns}, twist={"twist": twist})

    add(100.0, "/imu", imu)
    add(50.0, "/odometry", odometry)
    add(30.0, "/command", lambda ns, t: make_command(ns, math.cos(t), 0.1 * math.sin(3.0 * t)))
    if steering_from_s is not None:
        report = TYPES[STEERING]
        add(
            70.0, "/steering",
            lambda ns, t: report(stamp=time_of(ns), steering_tire_angle=0.08 * math.sin(3.0 * t)),
            steering_from_s,
        )  # fmt: skip
    return write(path, sorted(messages, key=lambda item: item[1]), store=STORE)


def options(command_type):
    return RecordingOptions(
        sensors=SensorConfig(command_type=command_type, mass=MASS, wheel_radius=WHEEL_RADIUS)
    )


def commands_at_ticks(log, record):
    """The sensor log's command in force at each tick of the record."""
    tick_s = (record.stamp_ns - log.start_ns) * 1e-9
    return log.command[np.searchsorted(log.command_s, tick_s, side="right") - 1]


@pytest.mark.parametrize(
    ("command_type", "make_command", "steering_from_s"),
    [
        ("autoware_control", control, 0.0),
        ("autoware_control", control, 2.0),
        ("autoware_control", control, None),
        ("ackermann", ackermann, None),
    ],
)
def test_record_and_sensor_log_have_the_same_commands(
    tmp_path, command_type, make_command, steering_from_s
):
    path = command_bag(tmp_path / "bag", make_command, steering_from_s)
    read = read_recording(path, options(command_type))
    log = read_sensor_log(path, options(command_type))
    assert read.topics.command == "/command"
    assert read.topics.steering == (None if steering_from_s is None else "/steering")
    assert log.torque_is_inferred
    np.testing.assert_array_equal(commands_at_ticks(log, read.record), read.record.u)
    time_s = (read.record.stamp_ns - START_NS) * 1e-9
    amplitude = np.where(
        time_s > 2.1 if steering_from_s == 2.0 else steering_from_s == 0.0, 0.08, 0.1
    )
    settled = np.abs(time_s - 2.0) > 0.1
    expected = amplitude * np.sin(3.0 * time_s)
    np.testing.assert_allclose(read.record.u[settled, 1], expected[settled], atol=0.012)
    torque = MASS * WHEEL_RADIUS * np.cos(time_s)
    np.testing.assert_allclose(read.record.u[:, 0], torque, atol=MASS * WHEEL_RADIUS * 0.04)


def test_joint_state_commands_keep_their_native_rate():
    path = bag("town", 20.0)
    read, log = read_recording(path), read_sensor_log(path)
    assert not log.torque_is_inferred
    assert log.command_s.size == len({item.stamp_ns for item in read.commands})
    first: dict[int, tuple[float, ...]] = {}
    for item in read.commands:
        first.setdefault(item.stamp_ns, item.values)
    np.testing.assert_array_equal(log.command, [first[stamp] for stamp in sorted(first)])
    np.testing.assert_array_equal(commands_at_ticks(log, read.record), read.record.u)
    assert log.start_ns == read.start_ns


def test_inferred_torque_is_not_used_for_longitudinal_effects(tmp_path):
    path = command_bag(tmp_path / "bag", ackermann)
    log = read_sensor_log(path, options("ackermann"))
    assert not observable_effects(log, MASS, WHEEL_RADIUS).torque
    assert observable_effects(replace(log, torque_is_inferred=False), MASS, WHEEL_RADIUS).torque


def test_both_readers_count_the_same_refusals(tmp_path):
    def broken(stamp_ns, acceleration, angle):
        return ackermann(stamp_ns, acceleration, math.nan if angle > 0.09 else angle)

    path = command_bag(tmp_path / "bag", broken)
    read = read_recording(path, options("ackermann"))
    log = read_sensor_log(path, options("ackermann"))
    (refused,) = [text for text in read.warnings if "refused" in text]
    assert refused in log.warnings
    assert refused.startswith("bag: ")
    assert "command messages refused: steering angle is not finite" in refused


def test_too_few_usable_messages_name_the_reason(tmp_path):
    path = command_bag(tmp_path / "bag", lambda ns, a, angle: ackermann(ns, a, math.nan))
    reason = r"0 usable command messages \(120 command messages refused: steering angle is not"
    with pytest.raises(DataError, match=reason):
        read_sensor_log(path, options("ackermann"))


def test_options_select_the_steering_topic_and_ignore_the_imu(tmp_path):
    path = command_bag(tmp_path / "bag", control, 0.0)
    chosen = replace(options("autoware_control"), use_imu=False, imu="/absent", steering="")
    with Bag(path) as opened:
        topics = choose_topics(opened, chosen)
    assert (topics.imu, topics.steering) == (None, None)


def test_frames_and_covariances_are_checked(tmp_path):
    """One line per fault, however many messages have it."""
    messages = []
    for topic, log_ns, msg in drive(800):
        if msg.__msgtype__ == "nav_msgs/msg/Odometry":
            covariance = np.zeros(36)
            covariance[7] = 1e9
            twist = replace(msg.twist, covariance=covariance)
            changed = replace(msg, child_frame_id="odom", twist=twist)
        else:
            changed = msg
        messages.append((topic, log_ns, changed))
    write(tmp_path / "bag", messages)
    warnings = read_recording(tmp_path / "bag").warnings
    assert [text for text in warnings if "child_frame_id" in text] == [
        "bag: odometry's child_frame_id is 'odom': the twist must be in the axes of the vehicle, "
        "such as base_link"
    ]
    assert sum("variance of v_y is above 10000" in text for text in warnings) == 1
