# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Planned commands: what is read from a trajectory message, and every refusal."""

import math
from collections.abc import Sequence
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest

from adk_ros.signals.command_plan import MAX_POINTS, CommandPlan, PlanDecoder, plan_types
from adk_ros.signals.decode import RefusedMessage, SensorConfig

S = 1_000_000_000
STAMP_NS = 1_700_000_000 * S + 250_000_000


def time(stamp_ns: int) -> Message:
    return Message(sec=stamp_ns // S, nanosec=stamp_ns % S)


def point(after_s: float, effort: Sequence[float], position: Sequence[float]) -> Message:
    return Message(effort=effort, positions=position, time_from_start=time(round(after_s * S)))


def trajectory(
    joints: Sequence[str] = ("drive", "steer"),
    points: Sequence[Message] | None = None,
    stamp_ns: int = STAMP_NS,
) -> Message:
    two = [point(0.0, [100.0, 0.0], [0.0, 0.1]), point(0.1, [200.0, 0.0], [0.0, 0.2])]
    header = Message(stamp=time(stamp_ns))
    return Message(header=header, joint_names=joints, points=two if points is None else points)


def control(acceleration: float, angle: float) -> Message:
    return Message(
        longitudinal=Message(acceleration=acceleration), lateral=Message(steering_tire_angle=angle)
    )


def control_horizon(**fields: Any) -> Message:
    given = {"stamp": time(STAMP_NS), "control_time": time(STAMP_NS + S), "time_step_ms": 50.0}
    return Message(**given | {"controls": [control(1.0, 0.1), control(2.0, 0.2)]} | fields)


def decode(msg: Any, now_ns: int | None = None, **config: Any) -> CommandPlan:
    return PlanDecoder(SensorConfig(**config)).decode(msg, now_ns)


def test_a_joint_trajectory() -> None:
    plan = decode(trajectory())
    assert plan.stamp_ns == STAMP_NS
    assert plan.times_ns.tolist() == [STAMP_NS, STAMP_NS + S // 10]
    assert plan.commands.tolist() == [[100.0, 0.1], [200.0, 0.2]]


def test_commands_are_in_force_until_the_next() -> None:
    plan = decode(trajectory())
    after = np.array([-1, 0, S // 20, S // 10, S // 10 + 1])
    at = plan.at(STAMP_NS + after)
    assert at[:, 0].tolist() == pytest.approx([math.nan, 100, 100, 200, math.nan], nan_ok=True)
    assert np.isnan(at[[0, -1]]).all()


def test_efforts_add_up_and_the_hand_wheel_is_converted() -> None:
    joints, ahead = ["s", "left", "right"], [point(0.0, [0.0, 10.0, 20.0], [1.6, 0.0, 0.0])]
    plan = decode(
        trajectory(joints, ahead),
        drive_joints=("left", "right"), steer_joint="s", steering_ratio=16.0,
    )  # fmt: skip
    assert plan.commands.tolist() == [[30.0, 0.1]]


def test_one_of_both_commands_may_be_planned() -> None:
    steering = decode(trajectory(["steer"], [point(0.0, [], [0.1])]))
    assert np.isnan(steering.commands[0, 0])
    assert steering.commands[0, 1] == 0.1
    torque = decode(trajectory(["drive"], [point(0.0, [50.0], [])]))
    assert torque.commands[0, 0] == 50.0
    assert np.isnan(torque.commands[0, 1])


def test_without_a_stamp_a_plan_begins_now() -> None:
    assert decode(trajectory(stamp_ns=0), STAMP_NS).times_ns[0] == STAMP_NS
    with pytest.raises(RefusedMessage, match="no time stamp"):
        decode(trajectory(stamp_ns=0))


def test_a_plan_is_as_late_as_the_commands() -> None:
    """The stamps of a planner are those of the sensors; without one, no delay is left."""
    late: dict[str, Any] = {"command_delay": 0.1}
    plan = decode(trajectory(), **late)
    assert plan.stamp_ns == plan.times_ns[0] == STAMP_NS - S // 10
    assert decode(trajectory(stamp_ns=0), STAMP_NS, **late).times_ns[0] == STAMP_NS
    late |= {"command_type": "autoware_control", "mass": 1000.0, "wheel_radius": 0.3}
    plan = decode(control_horizon(), **late)
    assert (plan.stamp_ns, plan.times_ns[0]) == (STAMP_NS - S // 10, STAMP_NS + S - S // 10)
    plan = decode(control_horizon(control_time=time(0)), **late)
    assert plan.times_ns[0] == plan.stamp_ns == STAMP_NS - S // 10
    plan = decode(control_horizon(stamp=time(0), control_time=time(0)), STAMP_NS, **late)
    assert plan.times_ns[0] == plan.stamp_ns == STAMP_NS


def test_a_control_horizon() -> None:
    car: dict[str, Any] = {
        "command_type": "autoware_control", "mass": 1000.0, "wheel_radius": 0.3
    }  # fmt: skip
    plan = decode(control_horizon(), **car)
    assert plan.stamp_ns == STAMP_NS
    assert plan.times_ns.tolist() == [STAMP_NS + S, STAMP_NS + S + S // 20]
    assert plan.commands.tolist() == [[300.0, 0.1], [600.0, 0.2]]
    # Without a control time it begins when it was made.
    assert decode(control_horizon(control_time=time(0)), **car).times_ns[0] == STAMP_NS
    for step in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(RefusedMessage, match="time step"):
            decode(control_horizon(time_step_ms=step), **car)
    assert plan_types("autoware_control")[0] == "autoware_control_msgs/msg/ControlHorizon"
    assert plan_types("joint_state") == ("trajectory_msgs/msg/JointTrajectory",)


@pytest.mark.parametrize(
    ("msg", "reason"),
    [
        (trajectory(points=[]), "no points"),
        (trajectory(points=[point(0.0, [0.0, 0.0], [0.0, 0.0])] * 2), "do not increase"),
        (trajectory(["a", "b"]), "none of the joints 'drive', 'steer'"),
        (trajectory(points=[point(0.0, [math.nan, 0.0], [0.0, 0.0])]), "not finite"),
        (trajectory(points=[point(0.0, [0.0, 0.0], [0.0, math.inf])]), "not finite"),
        (trajectory(points=[point(0.0, [1e9, 0.0], [0.0, 0.0])]), "above 1e"),
        (trajectory(points=[point(0.0, [0.0, 0.0], [0.0, 5.0])]), "hand-wheel"),
        (trajectory(points=[point(0.0, [0.0, 0.0], [])]), "no position"),
        (trajectory(points=[point(0.0, [], [0.0, 0.0])]), "no effort"),
        (
            trajectory(points=[point(i / S, [0.0] * 2, [0.0] * 2) for i in range(MAX_POINTS + 1)]),
            "more than",
        ),
        (Message(), "not the expected message type"),
    ],
)
def test_a_faulty_plan_is_refused_and_counted(msg: Any, reason: str) -> None:
    decoder = PlanDecoder(SensorConfig())
    for _ in range(2):
        with pytest.raises(RefusedMessage, match=reason):
            decoder.decode(msg, STAMP_NS)
    assert list(decoder.refused.values()) == [2]
    assert decoder.received == 2


@pytest.mark.parametrize(
    ("config", "reason"),
    [({"torque_scale": 1e-5}, "drive torque"), ({"steering_offset": -1.5}, "steering angle")],
)
def test_limits_apply_to_what_is_used(config: dict[str, Any], reason: str) -> None:
    """As to commands; what is not planned has no limit."""
    with pytest.raises(RefusedMessage, match=reason):
        decode(trajectory(), **config)
    joint = "steer" if "torque_scale" in config else "drive"
    one = point(0.0, [] if joint == "steer" else [100.0], [] if joint == "drive" else [0.1])
    assert np.isfinite(decode(trajectory([joint], [one]), **config).commands).sum() == 1


def test_all_drive_joints_are_planned_or_none() -> None:
    with pytest.raises(RefusedMessage, match="joint 'right' is missing"):
        decode(trajectory(["left", "steer"]), drive_joints=("left", "right"))
