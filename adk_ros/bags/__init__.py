# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Read rosbag2 (mcap, sqlite3) and ROS 1 recordings; write rosbag2 recordings.

A bag is read from its storage files; `metadata.yaml` only gives their names and message count. A
recording whose recorder was killed, or whose disk was full, is read up to the cut (`recovery`);
`Bag.warnings` reports the loss. Each message type is read by the definition in the bag
(`typestores`), so a type that cannot be parsed does not affect others. Types without a definition
are those of the common interfaces of ROS 2 Jazzy. Only this package imports rosbags.
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
