# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The predicted path begins at a pose that is used, on time, and is finite."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from typing import Any, cast

import numpy as np
import pytest
from helpers.node import Rig, write_model
from nav_msgs.msg import Path as PathMessage
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from adk_ros.model import artefact
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.model.predictor import Predictor
from adk_ros.ros.messages import join_stamp, split_stamp
from adk_ros.ros.plan_topics import PlanTopics
from adk_ros.ros.session import Session
from adk_ros.ros.traffic import Rates
from adk_ros.signals.channels import TICK_NS, Source
from adk_ros.signals.decode import SensorConfig

SPEED = 10.0
"""m/s along x of the poses, and of the car within one."""


class Recorder:
    """An output that is read."""

    is_read = True

    def __init__(self) -> None:
        self.sent: list[Any] = []

    def send(self, content: bytes) -> None:
        self.sent.append(deserialize_message(content, PathMessage))


class PathRig:
    """A rig whose odometry has poses, with the topics for planners of a node."""

    def __init__(self, node: Any, model: KoopmanModel, **given: Any) -> None:
        rates = given.pop("rates", Rates())
        self.rig = Rig(model, PipelineSettings(**given), rates=rates)
        qos = QoSProfile(depth=10)
        self.topics = cast(Any, PlanTopics(node, self.rig.core, "base_link", 10, qos))
        self.paths = Recorder()
        self.topics._path_out = self.paths
        self.begin_ns = self.rig.stamp_ns
        cast(Any, self.rig.core)._publish = self.publish

    def publish(self, prediction: Any) -> None:
        self.rig.published.append(prediction)
        self.topics.publish(prediction)

    def drive(self, seconds: float, edit: Callable[[Any], Any] = lambda msg: msg) -> None:
        def change(source: Source, msg: Any) -> Any:
            if source is Source.ODOMETRY:
                after_s = (join_stamp(msg.header.stamp) - self.begin_ns) * 1e-9
                msg.header.frame_id = "odom"
                msg.pose.pose.position.x = SPEED * after_s
                msg.pose.pose.orientation.w = 1.0
                msg.twist.twist.linear.x = SPEED
                msg = edit(msg)
                self.topics.odometry = msg
            return msg

        self.rig.drive(seconds, change)
        assert self.rig.core.counters.internal_errors == 0

    def deviations(self, delay_s: float = 0.0) -> Any:
        """First points of the paths minus where the car is then, m."""
        out = []
        for path in self.paths.sent:
            stamp_ns = join_stamp(path.header.stamp) + TICK_NS
            at = SPEED * ((stamp_ns - self.begin_ns) * 1e-9 + delay_s)
            out.append(path.poses[0].pose.position.x - at)
        return np.array(out)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> KoopmanModel:
    return artefact.load(write_model(tmp_path_factory.mktemp("model") / "model")).model


@pytest.fixture
def node() -> Iterator[Any]:
    with Session("planner") as session:
        yield session.node


def stray(stamp_ns: int) -> Callable[[Any], Any]:
    """Give the hundredth message a stamp, and a pose far away."""
    seen = [0]

    def edit(msg: Any) -> Any:
        seen[0] += 1
        if seen[0] == 100:
            msg = copy.deepcopy(msg)
            sent_ns = join_stamp(msg.header.stamp)
            at_ns = sent_ns + stamp_ns if stamp_ns else 0
            msg.header.stamp.sec, msg.header.stamp.nanosec = split_stamp(at_ns)
        return msg

    return edit


@pytest.mark.parametrize("offset_s", [0, 3600, -3600])
def test_a_wrong_stamp_moves_no_path(node: Any, model: KoopmanModel, offset_s: int) -> None:
    rig = PathRig(node, model)
    rig.drive(3.0, stray(offset_s * 10**9))
    assert len(rig.paths.sent) > 100
    assert np.abs(rig.deviations()).max() < 0.1


def test_a_known_delay_of_odometry_is_that_of_its_pose(node: Any, model: KoopmanModel) -> None:
    rig = PathRig(node, model, sensors=SensorConfig(odometry_delay=0.05))
    rig.drive(3.0)
    assert len(rig.paths.sent) > 100
    # A pose is where the car was 0.05 s before its stamp.
    assert np.abs(rig.deviations(0.05)).max() < 0.1


def test_a_car_that_brakes_while_odometry_is_missing_does_not_jump_back(
    node: Any, model: KoopmanModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = PathRig(node, model)
    rig.drive(3.0)
    lost_ns = rig.rig.stamp_ns
    state = cast(property, Predictor.present_state).fget
    assert state is not None

    def braking(predictor: Predictor) -> Any:
        """Return the state of a car that brakes by 6 m/s² since odometry is missing."""
        sample, present = rig.rig.pipeline.last_sample, state(predictor)
        assert sample is not None
        present[0] = SPEED - 6.0 * max(sample.stamp_ns - lost_ns, 0) * 1e-9
        return present

    monkeypatch.setattr(Predictor, "present_state", property(braking))
    rig.paths.sent.clear()
    rig.drive(1.4, lambda _: None)
    assert len(rig.paths.sent) > 45
    after_s = np.array([(join_stamp(p.header.stamp) - lost_ns) * 1e-9 for p in rig.paths.sent])
    # The path of a constant speed minus that of the car; the horizon knows nothing of braking.
    lag = 0.5 * 6.0 * np.maximum(after_s, 0.0) ** 2
    assert lag[-1] > 5.0
    assert np.abs(rig.deviations() + lag).max() < 1.0


def test_a_pose_without_height_gives_a_finite_path(node: Any, model: KoopmanModel) -> None:
    def flat(msg: Any) -> Any:
        msg.pose.pose.position.z = math.nan
        return msg

    rig = PathRig(node, model)
    rig.drive(2.0, flat)
    heights = [pose.pose.position.z for path in rig.paths.sent for pose in path.poses]
    assert len(heights) > 1000
    assert set(heights) == {0.0}


def test_samples_that_are_complete_together_have_a_path_each(
    node: Any, model: KoopmanModel
) -> None:
    """Odometry of 10 Hz completes several samples, whose states differ."""
    rig = PathRig(node, model, rates=Rates(imu_hz=200.0, odometry_hz=10.0, command_hz=40.0))
    rig.drive(4.0)
    assert len(rig.paths.sent) == len(rig.rig.published)
    assert np.abs(rig.deviations()[40:]).max() < 0.1


def test_a_state_that_is_not_the_vehicles_any_more_is_no_answer(model: KoopmanModel) -> None:
    rig = Rig(model)
    assert rig.core.outdated() == "no prediction yet"
    rig.drive(2.0)
    assert rig.core.outdated() == ""
    rig.mono_ns += 600_000_000
    assert rig.core.outdated() == "the last prediction is 0.6 s old"
    rig.drive(2.0)
    rig.core.enable(False)
    assert rig.core.outdated() == "the node is disabled"


def test_every_prediction_is_published_with_its_sample(model: KoopmanModel) -> None:
    rig = Rig(model, rates=Rates(imu_hz=0.0, odometry_hz=10.0, command_hz=10.0))
    stamps: list[tuple[int, int]] = []

    def publish(prediction: Any) -> None:
        sample = rig.pipeline.last_sample
        assert sample is not None
        stamps.append((prediction.origin_ns, sample.stamp_ns))

    cast(Any, rig.core)._publish = publish
    rig.drive(4.0, watch=False)
    assert len(stamps) > 100
    assert all(origin == sample for origin, sample in stamps)
