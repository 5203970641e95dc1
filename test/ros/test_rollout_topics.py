# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A running node answers requests for rollouts, and publishes its local linear model."""

import random
from pathlib import Path
from typing import Any

import numpy as np
from helpers.node import call, running_node, wait_for, write_model
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from adk_ros.model.rollout_requests import COLUMNS
from adk_ros.ros.rollout_topics import REFUSED, STEP, array_message
from adk_ros.ros.session import Session
from adk_ros.ros.traffic import message, motion
from adk_ros.signals.channels import Reading, Source

KINDS = {Source.IMU: Imu, Source.ODOMETRY: Odometry, Source.COMMAND: JointState}
START_NS = 1_760_000_000_000_000_000


def content(answer: Any) -> np.ndarray[Any, Any]:
    """Read an array as its layout says."""
    return np.asarray(answer.data).reshape([dimension.size for dimension in answer.layout.dim])


def test_a_running_node_answers_requests_and_publishes_its_linear_model(tmp_path: Path) -> None:
    model = write_model(tmp_path / "model")
    noise = random.Random(0)
    answers: dict[str, Any] = {}
    linear: list[Any] = []
    commands = np.random.default_rng(0).normal(0.0, [200.0, 0.02], (7, 30, 2))
    with running_node(model=str(model)) as node, Session("controller") as session:
        call(session, Trigger, "/predictor/reset", Trigger.Request())
        ros = session.node
        ros.create_subscription(
            Float64MultiArray, "/predictor/roll_out/states",
            lambda m: answers.update({m.layout.dim[0].label: m}), 10,
        )  # fmt: skip
        ros.create_subscription(
            Float64MultiArray, "/predictor/local_linear_model", linear.append, 10
        )
        inputs = {s: ros.create_publisher(k, s.name.lower(), 50) for s, k in KINDS.items()}
        requests = ros.create_publisher(Float64MultiArray, "/predictor/roll_out/commands", 10)
        tick = 0

        def drive() -> bool:
            nonlocal tick
            tick += 1
            stamp_ns = START_NS + tick * 10_000_000
            for source, publisher in inputs.items():
                values = motion(source, tick * 0.01, noise)
                publisher.publish(message(Reading(source, stamp_ns, values)))
            if tick % 10 == 0:
                requests.publish(array_message(commands, ("good", "step", "channel")))
                bad = array_message(commands[0], ("bad", "step"))
                requests.publish(bad)
                requests.publish(Float64MultiArray())
            good = "good" in answers and content(answers["good"]).size > 0
            return good and {"bad", ""} <= answers.keys() and len(linear) > 20

        wait_for(session, drive, 60.0)
        assert node.end()[0] == 0
    good = answers["good"]
    states = content(good)
    assert states.shape == (7, 30, 4)
    assert good.layout.dim[2].label.split() == list(COLUMNS)
    assert np.isfinite(states).all()
    assert (states[..., 3] == 1.0).all()
    # All candidates start from the same state, which the first step has hardly left.
    assert np.ptp(states[:, 0, 0]) < 0.5
    begin = float(good.layout.dim[1].label.removeprefix(STEP))
    assert START_NS * 1e-9 < begin <= (START_NS + tick * 10_000_000) * 1e-9
    bad = answers["bad"].layout.dim[1].label
    assert bad.startswith(f"{REFUSED}the layout has other dimensions ([30, 2]")
    assert answers[""].layout.dim[1].label.startswith(REFUSED)
    assert not len(answers["bad"].data)
    blocks = content(linear[-1])
    n = blocks.shape[1] - 3
    assert blocks.shape == (81, n + 3, n + 3)
    assert linear[-1].layout.dim[0].label.startswith(STEP)
    assert np.isfinite(blocks).all()
    # Block 0 is the start: A and B are zero, and the last column begins with the present speed.
    assert not blocks[0, :, :-1].any()
    assert blocks[0, 0, -1] > 1.0
