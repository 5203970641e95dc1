# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A node that receives the sensor messages and republishes them: the least a node in Python costs.

The benchmark compares the predictor's CPU load with it.
"""

from __future__ import annotations

from typing import Any

from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from adk_ros.ros.session import Session, stopping
from adk_ros.ros.traffic import KINDS

_DEPTH = 200
"""Queue depth, messages, as that of the predictor's subscriptions."""
_SPIN_S = 0.1


def relay_sensors() -> int:
    """Republish imu, odometry and command below `~/` until a signal; return the count."""
    profile: Any = QoSProfile
    qos = profile(
        history=HistoryPolicy.KEEP_LAST, depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT
    )
    count = 0
    with Session("adk_relay") as session, stopping() as stopped:
        for source, kind in KINDS.items():
            topic = source.name.lower()
            publisher = session.node.create_publisher(kind, f"~/{topic}", qos)

            def republish(msg: Any, publisher: Any = publisher) -> None:
                nonlocal count
                count += 1
                publisher.publish(msg)

            session.node.create_subscription(kind, topic, republish, qos)
        while not stopped():
            session.spin(_SPIN_S)
    return count
