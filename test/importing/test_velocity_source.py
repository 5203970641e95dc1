# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags whose odometry reports no velocity are read by their wheel speeds or GPS velocity."""

import json
from functools import lru_cache

import numpy as np
import pytest

from adk_ros.api.recording import read_log, read_recording, velocity_source
from adk_ros.bags import Bag, BagWriter, message
from adk_ros.bags.recording import RecordingOptions
from adk_ros.cli.main import main
from adk_ros.errors import DataError
from adk_ros.mismatch.recording.dead_channels import without_dead_channels
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.offline.export import write_bag
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.sensors import Sensors, Wheels
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.signals.channels import Source
from adk_ros.signals.decode import SensorConfig

SECONDS = 45.0
TWIST = "geometry_msgs/msg/TwistStamped"
RADIUS = 0.325


@lru_cache
def drive():
    scenario = load_scenario("town").model_copy(update={"sensors": Sensors(wheels=Wheels())})
    return simulate(scenario, duration_s=SECONDS)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("velocity_source") / "whole"
    write_bag(drive(), path)
    return path


def reduced(whole, path, without=(), has_gps=False, is_still=False):
    """Write a bag without some topics; a GPS velocity at 10 Hz; odometry without velocities."""
    gps = message(TWIST, header={"stamp": 0, "frame_id": "enu"})
    with Bag(whole) as bag, BagWriter(path) as writer:
        kinds = {topic.name: topic.msgtype for topic in bag.topics}
        for name in kinds.keys() - set(without):
            writer.add_topic(name, kinds[name])
        if has_gps:
            writer.add_topic("/gps/velocity", TWIST)
        count = 0
        for topic, log_ns, msg in bag.messages(list(kinds)):
            if topic == "/odometry":
                twist, count = msg.twist.twist, count + 1
                if has_gps and count % 5 == 0:
                    gps.header.stamp, gps.twist.linear.y = msg.header.stamp, twist.linear.x
                    writer.write("/gps/velocity", gps, log_ns)
                if is_still:
                    twist.linear.x = twist.linear.y = twist.angular.z = 0.0
            if topic not in without:
                writer.write(topic, msg, log_ns)
    return path


def error_of(recording):
    """Return the RMS error of v_x, m/s, against the truth."""
    truth = drive()
    _, ours, theirs = np.intersect1d(
        recording.record.stamp_ns, truth.stamp_ns, return_indices=True
    )
    errors = recording.record.x_ref[ours, 0] - truth.x[theirs, 0]
    return float(np.sqrt(np.nanmean(errors**2)))


def test_a_log_for_mismatch_is_read_by_wheel_speeds_and_says_so(whole, tmp_path):
    path = reduced(whole, tmp_path / "bag", is_still=True)
    log = read_log(path, wheel_radius=RADIUS)
    assert any("wheel" in text for text in log.warnings)
    truth = drive()
    true = np.interp(log.odometry_s, (truth.stamp_ns - log.start_ns) * 1e-9, truth.x[:, 0])
    assert np.sqrt(np.mean((log.odometry[:, 0] - true) ** 2)) < 0.2
    plain = read_log(whole)
    assert np.array_equal(plain.odometry, read_sensor_log(whole).odometry)
    assert not any("wheel" in text for text in plain.warnings)


def test_wheel_speeds_take_the_place_of_odometry_with_the_radius_by_gps(whole, tmp_path):
    path = reduced(whole, tmp_path / "bag", ["/odometry"], has_gps=True)
    recording = read_recording(path)
    sensors = recording.options.sensors
    assert sensors.odometry_type == "wheel_joints"
    assert abs(sensors.wheel_radius / RADIUS - 1.0) < 0.01
    assert error_of(recording) < 0.15
    assert any("wheel radius 0.32" in line for line in recording.warnings)
    assert recording.record.measured.tolist() == [True, False, True]


def test_a_given_radius_needs_no_gps_and_none_leaves_the_bag_unreadable(whole, tmp_path):
    path = reduced(whole, tmp_path / "bag", ["/odometry"])
    options, line = velocity_source(path, None, wheel_radius=RADIUS)
    assert options.sensors.wheel_radius == RADIUS
    assert "wheel radius 0.325 m" in line
    assert velocity_source(path, None) == (RecordingOptions(), "")
    with pytest.raises(DataError, match="set odometry_type in --params, and wheel_radius"):
        read_recording(path)


def test_info_says_what_such_a_bag_allows(whole, tmp_path, capsys):
    path = reduced(whole, tmp_path / "bag", ["/odometry"], has_gps=True)
    assert main(["info", str(path), "--json"]) == 0
    about = json.loads(capsys.readouterr().out)
    assert about["used_as"]["odometry"] == "/vehicle/wheels"
    assert about["verdict"] == "usable for training and replay, not for v_y"
    rows = {row["name"]: row["possible"] for row in about["scope"]}
    assert (rows["judge v_x"], rows["judge yaw rate"], rows["judge v_y"]) == ("yes", "yes", "no")
    assert "v_x from rear_left" in about["warnings"][0]


def test_a_receiver_alone_gives_the_speed(whole, tmp_path):
    path = reduced(whole, tmp_path / "bag", ["/odometry", "/vehicle/wheels"], has_gps=True)
    recording = read_recording(path)
    assert recording.options.sensors.odometry_type == "ground_velocity"
    assert error_of(recording) < 0.1


def test_odometry_with_a_velocity_is_used_and_one_without_is_not(whole, tmp_path):
    assert read_recording(whole).options.sensors == SensorConfig()
    path = reduced(whole, tmp_path / "bag", is_still=True)
    recording = read_recording(path)
    # Its positions give the radius.
    assert recording.options.sensors.odometry_type == "wheel_joints"
    assert error_of(recording) < 0.2


def test_an_estimated_v_y_is_in_the_record_and_counts_as_not_measured(whole):
    options = RecordingOptions(sensors=SensorConfig(sideslip=(1.4, 0.004)))
    recording = read_recording(whole, options)
    record = recording.record
    assert record.estimated == ("v_y",)
    assert record.rows(slice(10)).estimated == ("v_y",)
    assert record.measured.tolist() == [True, False, True]
    assert np.ptp(record.x_ref[:, 1]) > 0.1
    log = read_sensor_log(whole, options)
    assert not log.measures_v_y
    assert np.ptp(without_dead_channels(log)[0].odometry[:, 1]) == 0.0


def test_the_command_is_found_next_to_wheel_speeds_of_the_same_type(whole):
    log = read_sensor_log(whole)
    assert np.ptp(log.command[:, 1]) > 0.01
    assert log.odometry_s.size == drive().streams[Source.ODOMETRY].stamp_ns.size
