# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bags: rosbag2 (mcap, sqlite3) and ROS 1 recordings in, rosbag2 recordings out.

A bag is read from its storage files; `metadata.yaml` only says which they are and how much they
should hold. So a recording whose recorder was killed, or whose disk ran full, is read up to the
cut (`recovery`), and what is lost is said in `Bag.warnings`. Every message type is read by the
definition that the bag itself carries, and by that alone (`typestores`): one that cannot be
understood hinders no other. Types without a definition are taken from ROS 2 Jazzy's common
interfaces. Nothing outside this package imports rosbags.
"""

from adk_ros.bags.messages import message
from adk_ros.bags.reader import Bag, TopicInfo, open_bag
from adk_ros.bags.topics import (
    COMMAND_TYPES,
    IMU_TYPE,
    ODOMETRY_TYPE,
    STEERING_TYPE,
    Topics,
    find_topics,
)
from adk_ros.bags.typestores import add_type
from adk_ros.bags.writer import BagWriter

__all__ = [
    "COMMAND_TYPES",
    "IMU_TYPE",
    "ODOMETRY_TYPE",
    "STEERING_TYPE",
    "Bag",
    "BagWriter",
    "TopicInfo",
    "Topics",
    "add_type",
    "find_topics",
    "message",
    "open_bag",
]
