# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags whose odometry reports no velocity are read by their wheel speeds or GPS velocity."""

import json
from functools import lru_cache

import numpy as np
import pytest
from helpers.auxiliary_bags import with_auxiliary_topics
from helpers.calibration import existing

from adk_ros.api.recording import read_log, read_recording, velocity_source
from adk_ros.bags import Bag, BagWriter, message
from adk_ros.bags import recording as bag_reader
from adk_ros.bags.auxiliary_topics import TWIST, WHEEL_TOPICS
from adk_ros.bags.recording import RecordingOptions, choose_topics, messages_of
from adk_ros.calibration.from_bag import StreamReader, read_streams
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


@pytest.fixture(scope="module")
def single(tmp_path_factory):
    """Return a bag with a topic for each of four wheels and a receiver, without odometry."""
    path = tmp_path_factory.mktemp("single_wheels") / "bag"
    return with_auxiliary_topics(drive(), path, without=["/odometry"], gps_factor=1.0)


def test_the_topics_of_single_wheels_are_read_as_their_axle(single):
    recording = read_recording(single)
    options = recording.options
    assert options.sensors.odometry_type == "wheel_speed"
    used = [WHEEL_TOPICS[at] for at in ("rear_left", "rear_right")]
    assert [options.odometry, *options.wheels] == used
    assert abs(options.sensors.wheel_radius / RADIUS - 1.0) < 0.01
    assert error_of(recording) < 0.15
    (line,) = [text for text in recording.warnings if "v_x from" in text]
    assert f"v_x from {used[0]}, {used[1]}" in line
    assert "wheel radius 0.32" in line


def test_a_model_of_wheel_speeds_reads_the_same_axle(single):
    """As replay does, with the sensors that the model stores and no topic."""
    sensors = SensorConfig(odometry_type="wheel_speed", wheel_radius=0.33)
    options = read_recording(single, RecordingOptions(sensors=sensors)).options
    used = [WHEEL_TOPICS[at] for at in ("rear_left", "rear_right")]
    assert [options.odometry, *options.wheels] == used
    assert options.sensors == sensors
    named = RecordingOptions(odometry=used[0], sensors=sensors)
    assert read_recording(single, named).options.wheels == ()


def test_single_wheels_say_what_the_joints_of_the_same_wheels_do(single, tmp_path):
    joints = with_auxiliary_topics(
        drive(), tmp_path / "joints", without=["/odometry"], gps_factor=1.0, keeps_joints=True
    )
    ours, theirs = read_recording(single), read_recording(joints)
    assert np.array_equal(ours.record.stamp_ns, theirs.record.stamp_ns)
    assert ours.options.sensors.wheel_radius == theirs.options.sensors.wheel_radius
    assert np.allclose(ours.record.x_ref, theirs.record.x_ref, atol=1e-9, equal_nan=True)


def test_all_readers_join_single_wheels_alike(single):
    options = read_recording(single).options
    with Bag(single) as bag:
        topics = choose_topics(bag, options)
        joined = [
            1e-9 * msg.header.stamp.nanosec + msg.header.stamp.sec
            for topic, _, msg in messages_of(bag, topics)
            if topic == topics.odometry
        ]
        (count,) = {x.count for x in bag.topics if x.name in (topics.odometry, *topics.wheels)}
    assert len(joined) == count
    streams = read_streams(single, options).streams
    odometry = existing(streams, "odometry")
    assert odometry.at_s.size == count
    # The front wheels are left to compare with.
    assert set(streams.wheel_speeds) == {"front_left", "front_right"}
    log = read_log(single)
    assert np.allclose(log.odometry[:, 0], odometry["v_x"], atol=1e-9)


def test_streams_and_record_of_one_pass_are_those_of_two(single):
    options = read_recording(single).options
    with Bag(single) as bag:
        reader = StreamReader(bag, options)
    record = bag_reader.read_recording(single, options, observer=reader).record
    alone = bag_reader.read_recording(single, options).record
    assert np.array_equal(record.x_ref, alone.x_ref, equal_nan=True)
    streams, expected = reader.content().streams, read_streams(single, options).streams
    assert set(streams.wheel_speeds) == set(expected.wheel_speeds)
    for ours, theirs in zip(streams.present(), expected.present(), strict=True):
        assert np.array_equal(ours.at_s, theirs.at_s)
        for column, values in theirs.columns.items():
            assert np.array_equal(ours[column], values, equal_nan=True)


def test_front_wheels_serve_where_nothing_else_does(tmp_path):
    front = {"front_left": 1.0, "front_right": 1.0}
    path = with_auxiliary_topics(
        drive(), tmp_path / "bag", without=["/odometry"], wheels=front, gps_factor=1.0
    )
    options, line = velocity_source(path, None)
    assert options.odometry == WHEEL_TOPICS["front_left"]
    assert options.wheels == (WHEEL_TOPICS["front_right"],)
    assert "the only wheel speeds" in line
    assert error_of(read_recording(path)) < 0.4


def test_one_wheel_says_that_it_is_off_in_bends(tmp_path):
    path = with_auxiliary_topics(
        drive(), tmp_path / "bag", without=["/odometry"], wheels={"rear_left": 1.0}
    )
    options, line = velocity_source(path, None, wheel_radius=RADIUS)
    assert options.odometry == WHEEL_TOPICS["rear_left"]
    assert options.wheels == ()
    assert "half the track" in line


def test_check_and_train_find_v_x_of_single_wheels(single, capsys):
    assert main(["check", str(single), "--vehicle", "imdv", "--json"]) == 0
    about = json.loads(capsys.readouterr().out)
    verdicts = {x["name"]: x["verdict"] for x in about["findings"]}
    assert verdicts["gps_scale"] == "ok"
    assert verdicts["wheel_radius_front_left"] == "ok"
    assert about["used_as"]["odometry"] == WHEEL_TOPICS["rear_left"]
