# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag of a car whose IMU lies upside down gives the same record if /tf_static says so."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.mismatch_report import drag
from helpers.node import readings, write_model
from scipy.spatial.transform import Rotation

from adk_ros.api.model import load_model
from adk_ros.api.recording import read_recording, recording_options
from adk_ros.api.rollout import rollout
from adk_ros.bags import Bag, BagWriter, message
from adk_ros.bags.recording import RecordingOptions
from adk_ros.cli.main import main
from adk_ros.errors import DataError
from adk_ros.mismatch import analysis, planned_drive
from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.inference import detectable_sizes
from adk_ros.mismatch.library.surrogate_parameters import default_parameters
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.ros.parameter_settings import differences_from_training
from adk_ros.signals.channels import Source
from adk_ros.signals.decode import SensorConfig

NOTE = "turned: IMU at (0, 0) m, rotated by (180, 0, 90)° (roll, pitch, yaw): /tf_static"
ROLL_YAW = (math.pi, 0.0, math.pi / 2)
KINDS = {
    Source.IMU: ("/imu/data", "sensor_msgs/msg/Imu"),
    Source.ODOMETRY: ("/odometry", "nav_msgs/msg/Odometry"),
    Source.COMMAND: ("/vehicle/command", "sensor_msgs/msg/JointState"),
}


def write(path: Path, *, is_turned: bool, tf: str = "", namespace: str = "") -> Path:
    """Write a slalom; `is_turned`: of an IMU that is rotated, `tf`: topic that says so."""
    to_sensor = Rotation.from_euler("xyz", ROLL_YAW).inv() if is_turned else Rotation.identity()
    with BagWriter(path) as writer:
        for topic, kind in KINDS.values():
            writer.add_topic(namespace + topic, kind)
        every = list(readings(4.0))
        if tf:
            writer.add_topic(tf, "tf2_msgs/msg/TFMessage")
            writer.write(tf, transforms(), every[0].stamp_ns)
        for reading in every:
            topic, kind = KINDS[reading.source]
            v = reading.values
            fields: dict[str, Any] = {"header": {"stamp": reading.stamp_ns, "frame_id": "imu"}}
            if reading.source is Source.IMU:
                force = to_sensor.apply([v[0], v[1], 9.81])
                rate = to_sensor.apply([0.0, 0.0, v[2]])
                fields["linear_acceleration"] = dict(zip("xyz", map(float, force), strict=True))
                fields["angular_velocity"] = dict(zip("xyz", map(float, rate), strict=True))
            elif reading.source is Source.ODOMETRY:
                twist = {"linear": {"x": v[0], "y": v[1]}, "angular": {"z": v[2]}}
                fields |= {"child_frame_id": "base_link", "twist": {"twist": twist}}
            else:
                fields |= {
                    "name": ["drive", "steer"],
                    "effort": [v[0], 0.0],
                    "position": [0.0, v[1]],
                }
            writer.write(namespace + topic, message(kind, **fields), reading.stamp_ns)
    return path


def transforms() -> Any:
    x, y, z, w = (float(v) for v in Rotation.from_euler("xyz", ROLL_YAW).as_quat())
    return message(
        "tf2_msgs/msg/TFMessage",
        transforms=[
            message(
                "geometry_msgs/msg/TransformStamped",
                header={"frame_id": "base_link"},
                child_frame_id="imu",
                transform={"rotation": {"x": x, "y": y, "z": z, "w": w}},
            )
        ],
    )


@pytest.fixture
def straight(tmp_path: Path) -> Path:
    return write(tmp_path / "straight", is_turned=False)


@pytest.mark.parametrize(
    ("topic", "namespace"),
    [("/tf_static", ""), ("/car1/tf_static", "/car1"), ("/tf_static", "/car1")],
)
def test_a_turned_imu_is_read_like_a_straight_one(
    straight: Path, tmp_path: Path, topic: str, namespace: str
) -> None:
    path = tmp_path / "turned"
    turned = read_recording(write(path, is_turned=True, tf=topic, namespace=namespace))
    expected = read_recording(straight)
    assert turned.record.x == pytest.approx(expected.record.x, abs=1e-6)
    assert turned.record.a == pytest.approx(expected.record.a, abs=1e-6, nan_ok=True)
    assert turned.options.sensors.imu_rotation == pytest.approx(ROLL_YAW)
    log = read_sensor_log(turned.path)
    assert log.imu == pytest.approx(read_sensor_log(straight).imu, abs=1e-6)


def test_transforms_of_another_car_are_not_used(straight: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "turned", is_turned=True, tf="/car2/tf_static", namespace="/car1")
    assert read_recording(path).options.sensors == SensorConfig()


def test_without_the_transform_it_is_not(straight: Path, tmp_path: Path) -> None:
    turned = read_recording(write(tmp_path / "turned", is_turned=True))
    assert np.abs(turned.record.a - read_recording(straight).record.a).max() > 0.5


@pytest.mark.parametrize(
    "sensors", [SensorConfig(use_tf=False), SensorConfig(imu_position=(0.1, 0.0))]
)
def test_parameters_override_what_the_bag_says(sensors: SensorConfig, tmp_path: Path) -> None:
    path = write(tmp_path / "turned", is_turned=True, tf="/tf_static")
    read = read_recording(path, RecordingOptions(sensors=sensors))
    assert read.options.sensors == sensors


@pytest.fixture
def turned(tmp_path: Path) -> Path:
    return write(tmp_path / "turned", is_turned=True, tf="/tf_static")


def test_the_pose_is_stated_only_where_the_bag_gives_it(straight: Path, turned: Path) -> None:
    assert read_recording(turned).content.extrinsics == NOTE
    log = read_sensor_log(turned)
    assert log.extrinsics == log.between(1.0, 2.0).extrinsics == NOTE
    ignored = RecordingOptions(sensors=SensorConfig(use_tf=False))
    assert read_sensor_log(turned, ignored).extrinsics == ""
    assert read_sensor_log(straight).extrinsics == read_recording(straight).content.extrinsics
    assert read_sensor_log(straight).extrinsics == ""


@pytest.mark.parametrize("kind", ["vehicle", "surrogate"])
def test_rollout_states_the_pose(
    turned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    model = "imdv"
    if kind == "surrogate":
        model = str(tmp_path / "simulation.yaml")
        Path(model).write_text(surrogate_yaml(default_parameters()))
    out = str(tmp_path / "rollouts.csv")
    given = ["--model", model, "--bag", str(turned), "--horizon", "0.5", "--out", out]
    assert main(["rollout", *given]) == 0
    assert NOTE in capsys.readouterr().err.splitlines()


def test_mismatch_states_the_pose_of_each_bag(
    straight: Path,
    turned: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(analysis, "identify_mismatch", lambda *_: drag())
    given = ["--simulation", str(turned), "--recording", str(straight)]
    assert main(["mismatch", *given, "--out", str(tmp_path / "report"), "--json"]) == 0
    assert capsys.readouterr().err.splitlines().count(NOTE) == 1


def test_detectable_states_the_pose(
    turned: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planned_drive, "planned_drive", lambda *_: None)
    monkeypatch.setattr(detectable_sizes, "detectable_sizes", lambda *_, **__: [])
    assert main(["detectable", "--simulation", str(turned), "--json"]) == 0
    assert NOTE in capsys.readouterr().err.splitlines()


def test_unreadable_transforms_are_a_warning(
    turned: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_bag = Bag.messages

    def messages(bag: Bag, topics: Any = None) -> Any:
        if topics == ["/tf_static"]:
            raise DataError(f"bag {bag.path}: /tf_static is encoded as 'json', not CDR")
        return of_bag(bag, topics)

    monkeypatch.setattr(Bag, "messages", messages)
    expected = (
        "turned: the pose of the IMU is not read (/tf_static is encoded as 'json', not CDR), and "
        "taken to be that of odometry's child frame: set imu_position and imu_rotation, or "
        "use_tf: false if it is right"
    )
    assert read_recording(turned).warnings[0] == expected
    assert read_sensor_log(turned).warnings == (expected,)
    assert read_sensor_log(turned).extrinsics == ""
    ignored = RecordingOptions(sensors=SensorConfig(use_tf=False))
    assert expected not in read_recording(turned, ignored).warnings


def test_a_model_from_before_use_tf_is_used_without_transforms(
    turned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_model(tmp_path / "model")
    manifest = json.loads((folder / "manifest.json").read_text())
    sensors = asdict(SensorConfig())
    del sensors["use_tf"]
    manifest["training"]["sensors"] = sensors
    (folder / "manifest.json").write_text(json.dumps(manifest))
    model = load_model(folder)
    options = recording_options(stored_sensors=model.sensors)
    assert options.sensors == SensorConfig(use_tf=False)
    assert differences_from_training(SensorConfig(), model.facts) == []
    made = rollout(turned, model, horizon_s=0.5)
    without = RecordingOptions(sensors=SensorConfig(use_tf=False))
    expected = rollout(turned, model, horizon_s=0.5, options=without)
    np.testing.assert_array_equal(made.predicted, expected.predicted)
    assert made.extrinsics == ""
    out = str(tmp_path / "r.csv")
    given = ["--model", str(folder), "--bag", str(turned), "--horizon", "0.5", "--out", out]
    assert main(["rollout", *given]) == 0
    assert NOTE not in capsys.readouterr().err
