# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Common interface of storage files: channels and raw messages."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

END_OF_TIME = 2**63 - 1
"""ns; largest log time of rosbag2, a signed 64-bit integer."""


@dataclass(frozen=True)
class Channel:
    """A topic in one storage file; `encoding` is "cdr", "ros1" or another, unsupported one."""

    id: int
    topic: str
    msgtype: str
    encoding: str
    definition: str
    definition_format: str
    count: int


class RawMessage(NamedTuple):
    """A stored message: channel id, log time in ns, serialised bytes."""

    channel: int
    log_ns: int
    data: bytes


class Storage(Protocol):
    """An opened storage file; `fault` describes damage, empty if there is none."""

    channels: list[Channel]
    start_ns: int
    end_ns: int
    fault: str

    def messages(self, ids: Collection[int]) -> Iterator[RawMessage]:
        """Yield the messages of the given channels, in log order."""

    def close(self) -> None:
        """Close the file."""


def ros2_type(name: str) -> str:
    """Return a ROS 1 type name ("pkg/Type") in the ROS 2 form ("pkg/msg/Type")."""
    package, _, remainder = name.partition("/")
    return name if "/" in remainder or not remainder else f"{package}/msg/{remainder}"
