# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A running node follows planned commands, says so, and publishes the path."""

import random
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from helpers.node import Rig, call, running_node, wait_for, write_model
from nav_msgs.msg import Path as PathMessage
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectory

from adk_ros.model import artefact
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.model.training_range import TrainingRange
from adk_ros.ros.diagnostics import Diagnostics, Level
from adk_ros.ros.echo import watch_diagnostics
from adk_ros.ros.messages import join_stamp, split_stamp
from adk_ros.ros.session import Session
from adk_ros.ros.traffic import message, motion
from adk_ros.signals.channels import TICK_NS, Reading, Source

OUTPUTS = {
    "predicted_horizon": MultiDOFJointTrajectory,
    "predicted_horizon_plan": JointState,
    "predicted_path": PathMessage,
    "predicted_path_covariance_stamped": JointTrajectory,
}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_model(tmp_path_factory.mktemp("model") / "model")


def plan(stamp_ns: int, time_s: float, seconds: float = 2.0) -> JointTrajectory:
    """The commands of the drive from a time on, every 25 ms."""
    made = JointTrajectory(joint_names=["drive", "steer"])
    made.header.stamp.sec, made.header.stamp.nanosec = split_stamp(stamp_ns)
    for step in range(round(seconds / 0.025) + 1):
        torque, delta = motion(Source.COMMAND, time_s + 0.025 * step, random.Random(0))
        sec, nanosec = split_stamp(step * TICK_NS)
        made.points.append(
            JointTrajectoryPoint(
                positions=[0.0, delta], effort=[torque, 0.0],
                time_from_start=Duration(sec=sec, nanosec=nanosec),
            )
        )  # fmt: skip
    return made


def test_the_diagnostics_tell_of_plans(model: Path) -> None:
    rig = Rig(artefact.load(model).model, PipelineSettings(horizon_steps=40))
    rig.drive(3.0)
    assert "plan.received" not in dict(rig.reports[-1].values)
    rig.core.on_plan(plan(rig.stamp_ns, 3.0, 20.0))
    rig.drive(0.4)
    report = dict(rig.report().values)
    assert (report["plan.received"], report["plan.delta"]) == ("1", "followed")
    assert rig.published[-1].planned_steps == (40, 40)
    # Nobody plans any more.
    rig.drive(1.0)
    last = rig.report()
    assert last.level is Level.WARN
    assert "torque and delta held: the plan is older than plan_timeout_s" in last.message
    assert rig.published[-1].planned_steps == (0, 0)
    rig.core.on_plan(JointTrajectory(joint_names=["a"]))
    rig.core.on_plan(object())
    refused = rig.report()
    assert "planned_command messages refused: the plan names none of the joints" in refused.message
    assert dict(refused.values)["plan.received"] == "3"
    assert "refused" not in rig.report().message
    assert rig.core.counters.internal_errors == 0
    assert rig.all_finite()


def test_the_warning_ends_after_the_plan_has(model: Path) -> None:
    rig = Rig(artefact.load(model).model, PipelineSettings(horizon_steps=40))
    rig.drive(3.0)
    rig.core.on_plan(plan(rig.stamp_ns, 3.0, 1.0))
    stale, later = rig.drive(2.0)
    assert stale.level is Level.WARN
    assert "torque and delta held: the plan is older than plan_timeout_s" in stale.message
    assert later.level is Level.OK
    assert dict(later.values)["plan.torque"] == "no plan"


def test_the_diagnostics_tell_of_extrapolation(model: Path) -> None:
    rig = Rig(artefact.load(model).model)
    slow = TrainingRange(np.full(7, -1.0), np.array([5.0, 1.0, 1.0, 1e4, 1.0, 20.0, 1.0]))
    rig.diagnostics = Diagnostics(rig.core, start_s=rig.mono_ns * 1e-9, trained=slow)
    waiting = rig.report()
    assert dict(waiting.values)["extrapolating"] == "no"
    report = rig.drive(3.0)[-1]
    assert report.level is Level.OK
    assert "predicting; extrapolating: v_x " in report.message
    assert "(trained on -1 to 5)" in dict(report.values)["extrapolating"]


def test_a_running_node_follows_plans_and_draws_the_path(model: Path) -> None:
    received: dict[str, list[Any]] = defaultdict(list)
    shown: dict[str, str] = {}
    noise = random.Random(0)
    with running_node(model=str(model)) as node, Session("planner") as session:
        call(session, Trigger, "/predictor/reset", Trigger.Request())
        ros = session.node
        watch_diagnostics(ros, shown)
        for name, kind in OUTPUTS.items():
            ros.create_subscription(kind, f"/predictor/{name}", received[name].append, 50)
        kinds = {source: type(message(Reading(source, 1, motion(source, 0.0, noise))))
                 for source in (Source.IMU, Source.ODOMETRY, Source.COMMAND)}  # fmt: skip
        inputs = {s: ros.create_publisher(k, s.name.lower(), 50) for s, k in kinds.items()}
        plans = ros.create_publisher(JointTrajectory, "planned_command", 5)
        tick = 0

        def drive() -> bool:
            nonlocal tick
            tick += 1
            stamp_ns = 1_760_000_000_000_000_000 + tick * 10_000_000
            for source, publisher in inputs.items():
                values = motion(source, tick * 0.01, noise)
                sent = message(Reading(source, stamp_ns, values))
                if source is Source.ODOMETRY:
                    sent.header.frame_id = "odom"
                    sent.pose.pose.position.x, sent.pose.pose.orientation.w = 0.1 * tick, 1.0
                publisher.publish(sent)
            if tick % 20 == 0:
                plans.publish(plan(stamp_ns, tick * 0.01))
            planned = [m for m in received["predicted_horizon_plan"] if m.position[1] > 1.5]
            return len(planned) > 20 and len(received["predicted_path_covariance_stamped"]) > 20

        wait_for(session, drive, 60.0)
        assert node.end()[0] == 0
    label = received["predicted_horizon_plan"][-1]
    assert list(label.name) == ["torque", "delta"]
    path = received["predicted_path"][-1]
    assert path.header.frame_id == "odom"
    assert len(path.poses) == 80
    assert join_stamp(path.poses[0].header.stamp) - join_stamp(path.header.stamp) == TICK_NS
    x = np.array([pose.pose.position.x for pose in path.poses])
    horizons = {join_stamp(m.header.stamp): m for m in received["predicted_horizon"]}
    horizon = horizons[join_stamp(path.header.stamp)]
    # The heading is zero at the start: x advances with the predicted speed.
    speed = horizon.points[0].velocities[0].linear.x
    assert (x[1] - x[0]) / 0.025 == pytest.approx(speed, rel=0.02)
    covariance = received["predicted_path_covariance_stamped"][-1]
    assert list(covariance.joint_names)[:3] == ["x x", "x y", "x yaw"]
    spread = np.array([np.sqrt(p.positions[0]) for p in covariance.points])
    assert (np.diff(spread) > 0.0).all()
