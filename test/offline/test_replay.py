# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk replay: the predictions of the live node, as a bag and as scores."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.node import write_bag, write_model
from helpers.train import (
    bag,
    changed_streams,
    drive,
    kept,
    lines,
    record,
    refused,
    small,
    small_without_imu,
)

from adk_ros.bags import Bag, BagWriter, message
from adk_ros.bags.recording import RecordingOptions
from adk_ros.cli.main import main
from adk_ros.model import artefact
from adk_ros.model.adaptation.online_methods import METHODS, OnlineSettings
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.pipeline import Pipeline, PipelineSettings
from adk_ros.model.prediction import Prediction
from adk_ros.model.stored_model import ENCODER
from adk_ros.offline.replay import (
    COVARIANCE_TOPIC,
    HORIZON_TOPIC,
    TWIST_TOPIC,
    ReplayOutput,
    replay,
)
from adk_ros.plant.scenario.sensors import Stream
from adk_ros.signals.channels import TICK_NS, Source
from adk_ros.signals.decode import SensorConfig

SOURCES = {
    "/imu/data": Source.IMU,
    "/odometry": Source.ODOMETRY,
    "/vehicle/command": Source.COMMAND,
}


@pytest.fixture(scope="module")
def model() -> KoopmanModel:
    return artefact.load(small().path).model


def replayed(path: Path, pipeline: Pipeline) -> list[tuple[int, Prediction]]:
    """Return the predictions of the pipeline, message by message, as in the node."""
    found = []
    with Bag(path) as opened:
        for topic, log_ns, msg in opened.messages():
            found += [(log_ns, prediction) for prediction in pipeline.take(SOURCES[topic], msg)]
    return found


def stamp(msg: Any) -> int:
    return int(msg.header.stamp.sec) * 10**9 + int(msg.header.stamp.nanosec)


def adk(capsys, *arguments: object) -> tuple[str, str]:
    assert main(["replay", *map(str, arguments)]) == 0
    printed = capsys.readouterr()
    return printed.out, printed.err


def test_replay_equals_the_pipeline(model: KoopmanModel) -> None:
    predicted, pipeline, warnings = replay(bag(), model, PipelineSettings(), RecordingOptions())
    expected = replayed(bag(), Pipeline(model))
    assert warnings == []
    assert len(predicted) == len(expected) > 1100
    assert pipeline.ticks >= len(predicted)
    assert pipeline.restarts == 1
    for ours, (_, theirs) in zip(predicted, expected, strict=True):
        assert ours.stamp_ns == theirs.stamp_ns == ours.origin_ns + TICK_NS
        for name in ("x", "covariance", "horizon", "innovation"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


def test_horizons_follow_the_plans_of_a_bag(model: KoopmanModel, tmp_path: Path) -> None:
    """Now and then a plan holds the steering that is in force, for three seconds."""
    kinds = {"/imu/data": "sensor_msgs/msg/Imu", "/odometry": "nav_msgs/msg/Odometry",
             "/vehicle/command": "sensor_msgs/msg/JointState"}  # fmt: skip
    plan_type, planned = "trajectory_msgs/msg/JointTrajectory", "/planner/planned_command"
    with Bag(bag()) as opened, BagWriter(tmp_path / "b") as writer:
        for topic, kind in {**kinds, planned: plan_type}.items():
            writer.add_topic(topic, kind)
        for number, (topic, log_ns, msg) in enumerate(opened.messages()):
            writer.write(topic, msg, log_ns)
            if topic == "/vehicle/command" and number % 50 == 0:
                points = [
                    message(
                        "trajectory_msgs/msg/JointTrajectoryPoint",
                        positions=[float(msg.position[1])], velocities=[], accelerations=[],
                        effort=[], time_from_start={"sec": sec, "nanosec": 0},
                    )
                    for sec in (0, 3)
                ]  # fmt: skip
                plan = message(
                    plan_type, header={"stamp": stamp(msg)}, joint_names=["steer"], points=points
                )
                writer.write(planned, plan, log_ns + 1)
    predicted, pipeline, _ = replay(tmp_path / "b", model, PipelineSettings(), RecordingOptions())
    assert pipeline.plan_decoder.received > 20
    assert not pipeline.plan_decoder.refused
    follows = [p.planned_steps for p in predicted]
    assert (0, 80) in follows
    assert all(torque == 0 for torque, _ in follows)


def test_predictions_of_another_point_are_labelled_so(model: KoopmanModel, tmp_path: Path) -> None:
    out = tmp_path / "p"
    settings = PipelineSettings(sensors=SensorConfig(reference_point=(1.2, 0.0)))
    replay(bag(), model, settings, RecordingOptions(), ReplayOutput(out, with_horizon=True))
    with Bag(out) as opened:
        frames = {
            msg.header.frame_id for _, _, msg in opened.messages([TWIST_TOPIC, HORIZON_TOPIC])
        }
    assert frames == {"centre_of_gravity"}


@pytest.mark.parametrize(
    ("parameters", "frame"),
    [
        ("frame_id: cog", "cog"),
        ("{frame_id: cog, reference_point: [1.2, 0.0]}", "cog"),
        ("reference_point: [1.2, 0.0]", "centre_of_gravity"),
        ("use_imu: auto", "base_link"),
    ],
)
def test_the_frame_is_that_of_the_node_with_the_same_parameters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], parameters: str, frame: str
) -> None:
    params = tmp_path / "predictor.yaml"
    params.write_text(f"/**:\n  ros__parameters:\n    {parameters}\n")
    recording = write_bag(tmp_path / "bag", 4.0)
    model, out = write_model(tmp_path / "model"), tmp_path / "p"
    arguments = ["--model", model, "--params", params, "--out", out, "--with-horizon"]
    adk(capsys, recording, *arguments)
    with Bag(out) as opened:
        frames = {
            msg.header.frame_id for _, _, msg in opened.messages([TWIST_TOPIC, HORIZON_TOPIC])
        }
    assert frames == {frame}


def test_a_replay_says_that_the_encoder_is_not_compiled(
    model: KoopmanModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(model.lifting, "warning", "the compiled encoder differs")
    _, _, warnings = replay(bag(), model, PipelineSettings(), RecordingOptions())
    assert warnings == ["the compiled encoder differs"]


def test_written_bag(model: KoopmanModel, tmp_path: Path) -> None:
    out = tmp_path / "p"
    predicted, _, _ = replay(
        bag(), model, PipelineSettings(), RecordingOptions(), ReplayOutput(out)
    )
    expected = replayed(bag(), Pipeline(model))
    with Bag(out) as opened, Bag(bag()) as original:
        assert opened.warnings == []
        assert {topic.name: topic.msgtype for topic in opened.topics} == {
            TWIST_TOPIC: "geometry_msgs/msg/TwistWithCovarianceStamped",
            "/odometry": "nav_msgs/msg/Odometry",
        }
        everything = [(topic, log_ns) for topic, log_ns, _ in opened.messages()]
        logs = [log_ns for _, log_ns in everything]
        assert logs == sorted(logs)
        twists = [(log_ns, msg) for _, log_ns, msg in opened.messages([TWIST_TOPIC])]
        copied = list(opened.raw(["/odometry"]))
        assert copied == list(original.raw(["/odometry"]))
    assert [log_ns for log_ns, _ in twists] == [log_ns for log_ns, _ in expected]
    assert len(twists) == len(predicted)
    unknown = [i for i in range(36) if i // 6 in (2, 3, 4) or i % 6 in (2, 3, 4)]
    for (log_ns, msg), prediction in zip(twists, predicted, strict=True):
        # Stamped with the predicted time, on the grid; logged as soon as its sample is complete.
        assert stamp(msg) == prediction.stamp_ns
        assert stamp(msg) % TICK_NS == 0
        assert 0 <= log_ns - prediction.origin_ns < 3 * TICK_NS
        assert msg.header.frame_id == "base_link"
        twist = msg.twist.twist
        assert [twist.linear.x, twist.linear.y, twist.angular.z] == prediction.x.tolist()
        assert (twist.linear.z, twist.angular.x, twist.angular.y) == (0.0, 0.0, 0.0)
        covariance = np.array(msg.twist.covariance)
        plane = covariance.reshape(6, 6)[np.ix_([0, 1, 5], [0, 1, 5])]
        np.testing.assert_array_equal(plane, prediction.covariance)
        np.testing.assert_array_equal(plane, plane.T)
        assert np.linalg.eigvalsh(plane)[0] > 0.0
        assert set(covariance[unknown]) == {0.0, 1e6}
        assert (covariance.reshape(6, 6).diagonal()[2:5] == 1e6).all()
    np.testing.assert_array_equal(np.diff([stamp(msg) for _, msg in twists]), TICK_NS)


def test_horizons_are_optional(model: KoopmanModel, tmp_path: Path) -> None:
    settings = PipelineSettings(horizon_steps=10)
    predicted, _, _ = replay(
        bag("town", 10.0),
        model,
        settings,
        RecordingOptions(),
        ReplayOutput(tmp_path / "p", with_horizon=True),
    )
    with Bag(tmp_path / "p") as opened:
        horizons = [msg for _, _, msg in opened.messages([HORIZON_TOPIC])]
    with Bag(tmp_path / "p") as opened:
        covariances = [msg for _, _, msg in opened.messages([COVARIANCE_TOPIC])]
    assert len(horizons) == len(covariances) == len(predicted)
    # The returned predictions have no covariance: for long bags it takes gigabytes.
    assert all(prediction.horizon_covariance.size == 0 for prediction in predicted)
    expected = replayed(bag("town", 10.0), Pipeline(model, settings))
    for msg, (_, prediction) in zip(covariances, expected, strict=True):
        assert [(dim.label, dim.size, dim.stride) for dim in msg.layout.dim] == [
            ("step", 10, 90), ("row", 3, 9), ("column", 3, 3),
        ]  # fmt: skip
        table = msg.data.reshape(10, 3, 3)
        np.testing.assert_array_equal(table, prediction.horizon_covariance)
        np.testing.assert_array_equal(table, table.transpose(0, 2, 1))
        assert np.linalg.eigvalsh(table).min() > 0.0
    for msg, prediction in zip(horizons, predicted, strict=True):
        assert stamp(msg) == prediction.origin_ns
        assert msg.joint_names == ["vehicle"]
        assert len(msg.points) == 10
        for step, point in enumerate(msg.points, start=1):
            after = point.time_from_start
            assert after.sec * 10**9 + after.nanosec == step * TICK_NS
            (twist,) = point.velocities
            state = [twist.linear.x, twist.linear.y, twist.angular.z]
            assert state == prediction.horizon[step - 1].tolist()
            assert len(point.transforms) == 0
        first = msg.points[0].velocities[0]
        assert [first.linear.x, first.linear.y, first.angular.z] == prediction.x.tolist()


def test_existing_output_is_kept(capsys, tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("important")
    line = refused(capsys, ["replay", bag(), "--model", small().path, "--out", tmp_path], 2)
    assert f"{tmp_path} is not empty and holds no earlier result: name another folder" in line
    assert (tmp_path / "kept").read_text() == "important"


@pytest.mark.slow
def test_printed_score(capsys, tmp_path: Path) -> None:
    out, err = adk(capsys, bag(), "--model", small().path, "--out", tmp_path / "p")
    assert lines(out)[0].startswith(f"RMSE on {bag().name}, method windowed (")
    for word in ("persistence", "integration", "yaw_rate", "0.025 s", "2 s"):
        assert word in out
    printed = lines(err)
    count = len(replayed(bag(), Pipeline(artefact.load(small().path).model)))
    assert printed[-1].startswith(f"{count} predictions 25 ms ahead on ")
    assert printed[-1].endswith(f"samples, in {tmp_path / 'p'}")
    _, err = adk(capsys, bag(), "--model", small().path)
    assert lines(err)[-1].endswith("(not written: no --out)")


@pytest.fixture(scope="module")
def scores() -> dict[str, dict[str, Any]]:
    return {}


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_every_method_runs(capsys, scores: dict[str, dict[str, Any]], method: str) -> None:
    out, _ = adk(capsys, bag("town", 20.0), "--model", small().path, "--method", method, "--json")
    result = json.loads(out)
    assert result["method"] == method
    # The paper's method diverges again and again; what no vehicle can follow is withheld.
    assert result["predictions"] > (400 if method == "swls" else 700)
    assert result["predictions"] <= result["ticks"]
    assert result["restarts"] == 1
    assert result["out"] is None
    assert all(value is not None and 0.0 <= value < 5.0 for value in result["innovation_rms"])
    assert result["score"]["starts"] > 100
    for other in scores.values():
        assert other["score"]["predictors"]["model"] != result["score"]["predictors"]["model"]
        naive = other["score"]["predictors"]["persistence"]
        assert naive == result["score"]["predictors"]["persistence"]
    scores[method] = result


@pytest.mark.slow
def test_window_and_ridge_have_an_effect(capsys) -> None:
    def innovation_rms(*more: str) -> Any:
        out, _ = adk(capsys, bag("town", 20.0), "--model", small().path, "--json", *more)
        return json.loads(out)["innovation_rms"]

    default = innovation_rms()
    online = small().run.model.online
    assert innovation_rms("--window", str(online.window), "--ridge", f"{online.ridge}") == default
    assert innovation_rms("--window", "50") != default
    assert innovation_rms("--ridge", "1e12") != default
    # Such a strong ridge suppresses all adaptation except the disturbance estimate.
    assert innovation_rms("--ridge", "1e12") == pytest.approx(
        innovation_rms("--method", "constant"), rel=1e-6
    )


def test_horizon_in_seconds(capsys, tmp_path: Path) -> None:
    path = bag("town", 10.0)
    adk(capsys, path, "--model", small().path, "--horizon", "0.5", "--with-horizon",
        "--out", tmp_path / "p")  # fmt: skip
    with Bag(tmp_path / "p") as opened:
        counts = {len(msg.points) for _, _, msg in opened.messages([HORIZON_TOPIC])}
    assert counts == {20}
    predicted = [
        lines(adk(capsys, path, "--model", small().path, "--horizon", seconds)[1])[-1]
        for seconds in ("0", "2")
    ]
    assert predicted[0] == predicted[1]


def test_innovations_are_scored(capsys) -> None:
    """Innovation: measured minus predicted one step before."""
    out, _ = adk(capsys, bag(), "--model", small().path, "--json")
    result = json.loads(out)
    of = record("town", 30.0)
    predicted = {
        p.stamp_ns: p.x for _, p in replayed(bag(), Pipeline(artefact.load(small().path).model))
    }
    rows = [i for i, at in enumerate(of.stamp_ns.tolist()) if at in predicted]
    innovations = np.array([of.x[i] - predicted[int(of.stamp_ns[i])] for i in rows])
    np.testing.assert_allclose(result["innovation_rms"], np.sqrt(np.mean(innovations**2, axis=0)))
    one_step = [result["score"]["predictors"]["model"][c]["rmse"][0] for c in ("v_x", "v_y")]
    np.testing.assert_allclose(one_step, result["innovation_rms"][:2], rtol=0.3)


def test_too_short_to_score_is_a_warning(capsys) -> None:
    out, err = adk(capsys, bag("town", 1.5), "--model", small().path)
    assert out == ""
    assert "warning: no stretch without gaps is as long as the horizon: nothing to score" in err
    out, _ = adk(capsys, bag("town", 1.5), "--model", small().path, "--json")
    assert json.loads(out)["score"] is None


def test_missing_imu_is_a_warning(capsys) -> None:
    missing = "warning: the model was trained with an IMU and there is none"
    without = bag("town", 20.0, imu=False)
    assert missing in adk(capsys, without, "--model", small().path)[1]
    assert missing in adk(capsys, bag("town", 20.0), "--model", small().path, "--no-imu")[1]
    assert missing not in adk(capsys, bag("town", 20.0), "--model", small().path)[1]
    assert missing not in adk(capsys, without, "--model", small_without_imu())[1]


def test_bag_used_in_training_is_a_warning(capsys, tmp_path: Path) -> None:
    _, err = adk(capsys, bag(), "--model", small().path)
    assert "not on unseen data" not in err
    known = bag("handling", 20.0)
    same = tmp_path / "handling"
    same.symlink_to(known)
    _, err = adk(capsys, same, "--model", small().path)
    assert "warning: the model was trained on a bag named handling: these scores are not on" in err


def with_other_joints(path: Path) -> Path:
    """The 20 s recording with other joint names and a steering gear of ratio 16."""
    with Bag(bag("town", 20.0)) as opened, BagWriter(path) as writer:
        for info in opened.topics:
            writer.add_topic(info.name, info.msgtype)
        for topic, log_ns, msg in opened.messages():
            other = renamed(msg) if topic == "/vehicle/command" else msg
            writer.write(topic, other, log_ns)
    return path


def renamed(msg: Any) -> Any:
    angle = 16.0 * float(msg.position[list(msg.name).index("steer")])
    torque = float(msg.effort[list(msg.name).index("drive")])
    return message(
        "sensor_msgs/msg/JointState",
        header={"stamp": stamp(msg)},
        name=["left", "right", "column"],
        position=[0.0, 0.0, angle],
        effort=[0.25 * torque, 0.75 * torque, 0.0],
    )


@pytest.mark.slow
def test_sensor_configuration_comes_from_the_model(capsys, tmp_path: Path) -> None:
    """The sensor configuration is stored with the model."""
    sensors = SensorConfig(
        drive_joints=("left", "right"), steer_joint="column", steering_ratio=16.0
    )
    loaded = artefact.load(small().path)
    program = (small().path / ENCODER).read_bytes()
    facts = loaded.manifest["training"] | {"sensors": asdict(sensors)}
    artefact.save(tmp_path / "m", program, loaded.model, facts)
    path = with_other_joints(tmp_path / "b")
    out, _ = adk(capsys, path, "--model", tmp_path / "m", "--json")
    plain, _ = adk(capsys, bag("town", 20.0), "--model", small().path, "--json")
    ours, theirs = json.loads(out), json.loads(plain)
    np.testing.assert_allclose(ours["innovation_rms"], theirs["innovation_rms"], rtol=1e-6)
    # Without it the bag cannot be read.
    line = refused(capsys, ["replay", path, "--model", small().path], 3)
    assert "joint 'drive' is missing" in line


def test_manifest_with_unknown_sensors_is_refused(capsys, tmp_path: Path) -> None:
    loaded = artefact.load(small().path)
    program = (small().path / ENCODER).read_bytes()
    facts = loaded.manifest["training"] | {"sensors": {"sonar": 3}}
    artefact.save(tmp_path / "m", program, loaded.model, facts)
    line = refused(capsys, ["replay", bag(), "--model", tmp_path / "m"], 2)
    assert "the model's manifest describes sensors that this version does not know" in line


def test_gap_in_the_bag_causes_a_restart(capsys, tmp_path: Path) -> None:
    start_ns = drive("town", 30.0).stamp_ns[0]

    def with_gap(source: Source, stream: Stream) -> Stream:
        since_s = (stream.stamp_ns - start_ns) * 1e-9
        return kept(stream, (since_s < 10.0) | (since_s > 14.0))

    path = changed_streams(drive("town", 30.0), tmp_path / "b", with_gap)
    out, _ = adk(capsys, path, "--model", small().path, "--json")
    result = json.loads(out)
    assert result["counts"]["clock jump"] == 1
    assert result["restarts"] == 2
    assert 950 < result["predictions"] < 1040


def test_progress_of_replay(model: KoopmanModel) -> None:
    progress: list[tuple[int, int]] = []
    replay(
        bag(), model, PipelineSettings(horizon_steps=0), RecordingOptions(),
        progress=lambda *at: progress.append(at),
    )  # fmt: skip
    assert progress[-1][0] == progress[-1][1]
    assert [done for done, _ in progress] == sorted({done for done, _ in progress})


def test_online_settings_default_to_those_of_the_model(model: KoopmanModel) -> None:
    stored, other = OnlineSettings("windowed", 77, 12.5), OnlineSettings("ffrls", forgetting=0.9)
    model = replace(model, online=stored)
    for online, expected in ((None, stored), (other, other)):
        settings = PipelineSettings(online=online, horizon_steps=0)
        _, pipeline, _ = replay(bag("town", 10.0), model, settings, RecordingOptions())
        assert pipeline.predictor.settings == expected
