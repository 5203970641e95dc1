# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading recordings: every verb prints the warnings about a bag."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.train import bag, changed_streams, drive, kept, lines, record, refused, small

import adk_ros
from adk_ros.api.fleet.shard_stage import ShardStage
from adk_ros.api.recording import read_log
from adk_ros.bags import Bag, BagWriter, message
from adk_ros.bags.recording import RecordingOptions, read_recording
from adk_ros.calibration.scope import Possible
from adk_ros.cli.main import main
from adk_ros.errors import DataError, UsageError
from adk_ros.importing.absent_command import with_absent_command
from adk_ros.mismatch.recording.recorded_scope import recorded_scope
from adk_ros.plant.scenario.sensors import Stream
from adk_ros.signals.channels import Source
from adk_ros.signals.decode import SensorConfig

SECONDS = 20.0


def rewritten(
    path: Path, change: Callable[[str, int, Any], Any], seconds: float = SECONDS
) -> Path:
    """Write the bag of a drive with `change` applied to each message; None drops the message."""
    with Bag(bag("town", seconds)) as opened, BagWriter(path) as writer:
        for info in opened.topics:
            writer.add_topic(info.name, info.msgtype)
        for number, (topic, log_ns, msg) in enumerate(opened.messages()):
            changed = change(topic, number, msg)
            if changed is not None:
                writer.write(topic, changed, log_ns)
    return path


def in_g(topic: str, _: int, msg: Any) -> Any:
    if topic == "/imu/data":
        for axis in "xyz":
            value = getattr(msg.linear_acceleration, axis) / 9.80665
            setattr(msg.linear_acceleration, axis, value)
    return msg


def in_degrees(topic: str, _: int, msg: Any) -> Any:
    if topic == "/imu/data":
        msg.angular_velocity.z = math.degrees(msg.angular_velocity.z)
    return msg


def some_broken(topic: str, number: int, msg: Any) -> Any:
    if topic == "/odometry" and number % 50 == 0:
        msg.twist.twist.linear.x = math.nan
    if topic == "/vehicle/command" and number % 100 == 0:
        msg.name = ["drive", "rudder"]
    return msg


FAULTS = {
    in_g: ["it looks like g, the topic must carry m/s²"],
    in_degrees: ["it looks like deg/s, the topic must carry rad/s"],
    some_broken: ["odometry messages refused: velocity is not finite or above 150 m/s",
                  "command messages refused: joint 'steer' is missing"],
}  # fmt: skip


@pytest.fixture(scope="module", params=FAULTS, ids=lambda change: change.__name__)
def faulty(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[str]]:
    path = tmp_path_factory.mktemp("faulty") / "faulty_bag"
    return rewritten(path, request.param), FAULTS[request.param]


def test_warnings_name_the_bag_and_the_remedy(faulty: tuple[Path, list[str]]) -> None:
    path, expected = faulty
    warnings = read_recording(path).warnings
    for text in expected:
        (found,) = [line for line in warnings if text in line]
        assert found.startswith("faulty_bag: ")
    assert len(warnings) == len(expected)


@pytest.mark.parametrize("verb", ["train", "replay", "rollout", "vehicle"])
def test_every_verb_prints_the_warnings(
    capsys, tmp_path: Path, faulty: tuple[Path, list[str]], verb: str
) -> None:
    path, expected = faulty
    model = small().path if verb in ("replay", "rollout") else Path("imdv")
    predictions = ["rollout", "--model", model, "--bag", path, "--out", tmp_path / "r"]
    arguments = {
        "train": ["train", path, "--out", tmp_path / "m", "--steps", "10", "--no-report"],
        "replay": ["replay", path, "--model", model],
        "rollout": predictions,
        "vehicle": predictions,
    }[verb]
    # Training fails because 20 s are too short; the warnings are printed before.
    assert main([str(item) for item in arguments]) == (3 if verb == "train" else 0)
    printed = [line for line in lines(capsys.readouterr().err) if line.startswith("warning: ")]
    for text in expected:
        assert any(text in line for line in printed), printed


def test_a_faultless_bag_is_read_without_warnings() -> None:
    read = read_recording(bag("town", SECONDS))
    assert read.warnings == []
    expected = record("town", SECONDS)
    for name in ("stamp_ns", "x", "u", "a", "flags", "x_ref", "episode"):
        np.testing.assert_array_equal(getattr(read.record, name), getattr(expected, name))
    assert read.record.name == bag("town", SECONDS).name
    with Bag(bag("town", SECONDS)) as opened:
        assert read.start_ns == opened.start_ns
    commands = drive("town", SECONDS).streams[Source.COMMAND]
    assert sorted(item.stamp_ns for item in read.commands) == commands.stamp_ns.tolist()
    assert {item.source for item in read.commands} == {Source.COMMAND}


def test_duplicates_and_late_messages_are_counted(tmp_path: Path) -> None:
    def change(source: Source, stream: Stream) -> Stream:
        if source is not Source.ODOMETRY:
            return stream
        rows = np.sort(np.concatenate([np.arange(len(stream.stamp_ns)), [100, 200, 300]]))
        doubled = kept(stream, rows)
        log_ns = doubled.log_ns.copy()
        log_ns[500] += 45_000_000
        return Stream(doubled.stamp_ns, log_ns, doubled.values)

    path = changed_streams(drive("town", SECONDS), tmp_path / "b", change)
    warnings = read_recording(path).warnings
    assert "b: 3 times duplicate" in warnings
    assert any("out of order" in text for text in warnings)


@pytest.mark.slow
@pytest.mark.usefixtures("one_candidate")
def test_warnings_of_several_bags_name_their_bag(capsys, tmp_path: Path) -> None:
    broken = rewritten(tmp_path / "broken", some_broken)
    arguments = ["train", str(bag("handling", 60.0)), str(broken), "--out", str(tmp_path / "m")]
    assert main([*arguments, "--steps", "10", "--no-report"]) == 0
    printed = lines(capsys.readouterr().err)
    starts = [line.split(":")[0] for line in printed if "; " in line and ": imu" in line]
    assert starts == [str(bag("handling", 60.0)), str(broken)]
    warnings = [line for line in printed if line.startswith("warning: ")]
    assert len(warnings) == 2
    assert all(line.startswith("warning: broken: ") for line in warnings)


def test_the_imu_can_be_ignored() -> None:
    read = read_recording(bag("town", SECONDS), RecordingOptions(use_imu=False))
    assert read.topics.imu is None
    assert np.isnan(read.record.a).all()
    without = record("town", SECONDS, imu=False)
    np.testing.assert_array_equal(read.record.x, without.x)


def test_topics_are_chosen_by_name(tmp_path: Path) -> None:
    """With two odometry topics, one must be named."""
    with Bag(bag("town", SECONDS)) as opened, BagWriter(tmp_path / "b") as writer:
        for info in opened.topics:
            writer.add_topic(info.name, info.msgtype)
        writer.add_topic("/other/odometry", "nav_msgs/msg/Odometry")
        for topic, log_ns, msg in opened.messages():
            writer.write(topic, msg, log_ns)
            if topic == "/odometry":
                writer.write("/other/odometry", msg, log_ns)
    with pytest.raises(DataError, match="--odometry"):
        read_recording(tmp_path / "b")
    read = read_recording(tmp_path / "b", RecordingOptions(odometry="/other/odometry"))
    assert read.topics.odometry == "/other/odometry"
    np.testing.assert_array_equal(read.record.x, record("town", SECONDS).x)


def test_velocities_are_moved_to_the_reference_point() -> None:
    """From the rear axle to the centre of gravity: v_y + x * yaw_rate."""
    options = RecordingOptions(use_imu=False, sensors=SensorConfig(reference_point=(1.4, 0.0)))
    moved = read_recording(bag("town", SECONDS), options).record
    plain = read_recording(bag("town", SECONDS), RecordingOptions(use_imu=False)).record
    shift = moved.x_ref - plain.x_ref
    np.testing.assert_allclose(shift[:, 1], 1.4 * plain.x_ref[:, 2], atol=1e-9)
    np.testing.assert_allclose(shift[:, [0, 2]], 0.0, atol=1e-12)


def test_a_parameter_file_describes_the_sensors(capsys, tmp_path: Path) -> None:
    """The node and the offline verbs read the same file."""

    def to_column(topic: str, _: int, msg: Any) -> Any:
        if topic == "/vehicle/command":
            return message(
                "sensor_msgs/msg/JointState",
                header={"stamp": msg.header.stamp.sec * 10**9 + msg.header.stamp.nanosec},
                name=["drive", "column"],
                position=[0.0, 16.0 * float(msg.position[1])],
                effort=[float(msg.effort[0]), 0.0],
            )
        return msg

    path = rewritten(tmp_path / "b", to_column)
    file = tmp_path / "predictor.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    steer_joint: column\n    steering_ratio: 16\n"
        "    drive_joints: [drive]\n"
    )
    out, plain = tmp_path / "r.csv", tmp_path / "plain.csv"
    arguments = ["rollout", "--model", "imdv", "--out"]
    assert main([*arguments, str(out), "--bag", str(path), "--params", str(file)]) == 0
    assert main([*arguments, str(plain), "--bag", str(bag("town", SECONDS))]) == 0
    np.testing.assert_allclose(
        np.loadtxt(out, delimiter=",", skiprows=1), np.loadtxt(plain, delimiter=",", skiprows=1),
        atol=1e-6,
    )  # fmt: skip
    capsys.readouterr()
    for content, reason in (
        ("steer_joint: [", "is not YAML"),
        ("a: 1", "holds no 'ros__parameters'"),
        ("x:\n  ros__parameters:\n    steering_ratio: much\n", "parameter 'steering_ratio'"),
        ("x:\n  ros__parameters:\n    steering_ratio: 0\n", "steering_ratio is 0"),
    ):
        file.write_text(content)
        refused = [*arguments, str(tmp_path / "new.csv"), "--bag", str(path)]
        assert main([*refused, "--params", str(file)]) == 2
        (line,) = lines(capsys.readouterr().err)
        assert reason in line


def test_a_constant_v_y_is_reported(tmp_path: Path) -> None:
    """Many software stacks publish a twist whose v_y is always zero."""
    with Bag(bag("town", 20.0)) as source, BagWriter(tmp_path / "zero") as writer:
        for info in source.topics:
            writer.add_topic(info.name, info.msgtype)
        for topic, log_ns, msg in source.messages():
            if topic == "/odometry":
                msg.twist.twist.linear.y = 0.0
            writer.write(topic, msg, log_ns)
    recording = read_recording(tmp_path / "zero")
    (warning,) = [text for text in recording.warnings if "v_y" in text]
    assert "odometry's v_y is 0 throughout: it is not measured" in warning
    assert not [text for text in read_recording(bag("town", 20.0)).warnings if "v_y" in text]


def a_x_flipped_without_torque(topic: str, _: int, msg: Any) -> Any:
    if topic == "/imu/data":
        msg.linear_acceleration.x *= -1.0
    if topic == "/vehicle/command":
        msg.effort = 0.0 * msg.effort
    return msg


def test_a_flipped_a_x_and_a_constant_torque_are_reported(capsys, tmp_path: Path) -> None:
    path = rewritten(tmp_path / "bag", a_x_flipped_without_torque, 60.0)
    found = read_recording(path).warnings
    assert [text.split(": ")[1].split(" ")[0:3] for text in found] == [
        ["the", "IMU's", "longitudinal"], ["the", "command's", "torque"]
    ]  # fmt: skip
    assert "opposite sign of the change of odometry's v_x" in found[0]
    assert "the command's torque is 0 throughout while v_x varies by" in found[1]
    capsys.readouterr()
    assert main(["info", str(path)]) == 0
    said = capsys.readouterr()
    warned = " ".join(said.err.split())
    assert all(text in warned for text in found)
    assert lines(said.out)[-1].strip() == (
        "usable for training and replay; v_x can only be predicted in reduced scope: torque of "
        "the command is 0 throughout"
    )
    assert main(["info", str(bag("town", 60.0))]) == 0
    assert "warning" not in capsys.readouterr().err


def without_commands(topic: str, _: int, msg: Any) -> Any:
    return None if topic == "/vehicle/command" else msg


def test_a_bag_without_commands_is_read_in_reduced_scope(capsys, tmp_path: Path) -> None:
    path = rewritten(tmp_path / "bag", without_commands, 60.0)
    read, full = adk_ros.read_recording(path), read_recording(bag("town", 60.0))
    (warning,) = read.warnings
    assert warning.startswith("bag: no command: v_x, v_y and yaw rate can only be predicted in")
    assert read.topics.command is None
    assert not read.record.u.any()
    common, mine, other = np.intersect1d(
        read.record.stamp_ns, full.record.stamp_ns, return_indices=True
    )
    assert len(common) > 2300
    np.testing.assert_array_equal(read.record.x_ref[mine], full.record.x_ref[other])
    assert main(["info", str(path)]) == 0
    said = capsys.readouterr()
    assert warning in " ".join(said.err.split())
    assert lines(said.out)[-1].strip() == (
        "usable for training and replay; v_x, v_y and yaw rate can only be predicted in reduced "
        "scope: the recording has no command"
    )


def test_a_command_of_another_type_or_by_name_is_not_replaced_by_zeros(tmp_path: Path) -> None:
    """Its values must not be lost unnoticed."""
    with pytest.raises(DataError, match="no command: no topic of type ackermann_msgs"):
        adk_ros.read_recording(
            bag("town", SECONDS),
            RecordingOptions(
                sensors=SensorConfig(command_type="ackermann", mass=1.0, wheel_radius=0.3)
            ),
        )
    path = rewritten(tmp_path / "bag", without_commands)
    with pytest.raises(UsageError, match="has no topic /vehicle/torque"):
        adk_ros.read_recording(path, RecordingOptions(command="/vehicle/torque"))


def test_a_sensor_log_without_commands_has_zeros_where_that_is_asked_for(tmp_path: Path) -> None:
    path = rewritten(tmp_path / "bag", without_commands)
    with pytest.raises(DataError, match="no command: no topic of type"):
        read_log(path)
    log, full = read_log(path, needs_command=False), read_log(bag("town", SECONDS))
    assert full.has_command
    assert not log.has_command
    np.testing.assert_array_equal(log.command_s, log.odometry_s)
    assert not log.command.any()
    np.testing.assert_array_equal(log.odometry, full.odometry)
    judged = [row for row in recorded_scope(log) if row.name.startswith("judge")]
    assert all("the recording has no command" in row.why for row in judged)
    assert all(row.possible is Possible.NO for row in judged)


def test_joint_states_of_wheels_are_no_command_unless_they_have_efforts(tmp_path: Path) -> None:
    def wheels(effort: list[float]) -> Callable[[str, int, Any], Any]:
        def change(topic: str, _: int, msg: Any) -> Any:
            if topic != "/vehicle/command":
                return msg
            names = ["rear_left", "rear_right"]
            return message(
                "sensor_msgs/msg/JointState", header=msg.header, name=names, effort=effort
            )

        return change

    for name, effort, expected in (("a", [], ""), ("b", [20.0, 20.0], None)):
        with Bag(rewritten(tmp_path / name, wheels(effort), 2.0)) as opened:
            assert with_absent_command(opened, RecordingOptions()).command == expected


@pytest.mark.slow
def test_every_verb_answers_a_bag_without_commands(capsys, tmp_path: Path) -> None:
    """In reduced scope, or in one line that says what to do."""
    path = rewritten(tmp_path / "bag", without_commands, 60.0)
    assert main(["check", str(path), "--json"]) == 0
    checked = json.loads(capsys.readouterr().out)
    assert checked["used_as"]["command"] is None
    scope = {row["name"]: row["possible"] for row in checked["scope"]}
    assert (scope["predict v_x"], scope["judge v_x"], scope["grade"]) == ("reduced", "no", "yes")
    assert main(["export", str(path), "--to", "csv", "--out", str(tmp_path / "t.csv")]) == 0
    header = (tmp_path / "t.csv").read_text(encoding="utf-8").splitlines()[0]
    assert "v_x" in header
    assert "torque" not in header
    capsys.readouterr()
    model = small().path
    assert main(["replay", str(path), "--model", str(model), "--json"]) == 0
    said = capsys.readouterr()
    assert "the model was trained with commands and there are none: naive predictors take" in (
        " ".join(said.err.split())
    )
    assert json.loads(said.out)["predictions"] > 2000
    line = refused(
        capsys, ["rollout", "--bag", path, "--model", model, "--out", tmp_path / "r"], 3
    )
    assert "no command: a rollout predicts with the recorded commands" in line
    with pytest.raises(DataError, match="no command: the model of a fleet is trained on commands"):
        ShardStage(str(tmp_path)).run(path, "bag")


def test_a_bag_that_cannot_be_read_is_not_called_usable(capsys, tmp_path: Path) -> None:
    def no_steering(topic: str, _: int, msg: Any) -> Any:
        if topic == "/vehicle/command":
            msg.name = ["drive", "rudder"]
        return msg

    path = rewritten(tmp_path / "bag", no_steering)
    assert main(["info", str(path)]) == 0
    verdict = lines(capsys.readouterr().out)[-1].strip()
    assert verdict.startswith("not usable for training or replay: bag has no usable command")
    assert "joint 'steer' is missing" in verdict


def test_a_misspelt_parameter_is_reported(capsys, tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("/**:\n  ros__parameters:\n    referense_point: [1.0, 0.0]\n")
    out = str(tmp_path / "r.csv")
    arguments = ["rollout", "--model", "imdv", "--bag", str(bag("town", 20.0)), "--out", out]
    assert main([*arguments, "--params", str(file)]) == 0
    assert "'referense_point' is unknown and ignored: did you mean 'reference_point'?" in (
        " ".join(capsys.readouterr().err.split())
    )


def test_the_version_is_printed(capsys) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("adk_ros 0.1")
