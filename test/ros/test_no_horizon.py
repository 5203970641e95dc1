# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A running node with `horizon_s` 0 publishes adapted twists, and no horizon."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

from geometry_msgs.msg import TwistWithCovarianceStamped
from helpers.node import call, running_node, wait_for, write_model
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from adk_ros.ros.echo import watch_diagnostics
from adk_ros.ros.session import Session
from adk_ros.ros.traffic import KINDS, message, motion
from adk_ros.signals.channels import Reading


def test_twists_without_a_horizon(tmp_path: Path) -> None:
    model = write_model(tmp_path / "model")
    twists: list[Any] = []
    horizons: list[Any] = []
    shown: dict[str, str] = {}
    noise = random.Random(0)
    with running_node(model=str(model), horizon_s=0.0) as node, Session("listener") as session:
        call(session, Trigger, "/predictor/reset", Trigger.Request())
        ros = session.node
        watch_diagnostics(ros, shown)
        ros.create_subscription(
            TwistWithCovarianceStamped, "/predictor/predicted_twist", twists.append, 50
        )
        ros.create_subscription(
            MultiDOFJointTrajectory, "/predictor/predicted_horizon", horizons.append, 50
        )
        inputs = {s: ros.create_publisher(k, s.name.lower(), 50) for s, k in KINDS.items()}
        tick = 0

        def drive() -> bool:
            nonlocal tick
            tick += 1
            stamp_ns = 1_760_000_000_000_000_000 + tick * 10_000_000
            for source, publisher in inputs.items():
                reading = Reading(source, stamp_ns, motion(source, tick * 0.01, noise))
                publisher.publish(message(reading))
            return len(twists) > 40 and "internal_errors" in shown

        wait_for(session, drive, 60.0)
        assert node.end()[0] == 0
    assert shown["internal_errors"] == "0"
    assert not horizons
