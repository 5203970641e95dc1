# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a storage file holds: channels and raw messages, whichever way it is read."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

END_OF_TIME = 2**63 - 1
"""ns; the last log time that rosbag2 can hold."""


@dataclass(frozen=True)
class Channel:
    """A topic as one storage file declares it; `encoding` is "cdr", "ros1" or a foreign one."""

    id: int
    topic: str
    msgtype: str
    encoding: str
    definition: str
    definition_format: str
    count: int


class RawMessage(NamedTuple):
    """A message as stored: its channel's id, log time in ns, serialised bytes."""

    channel: int
    log_ns: int
    data: bytes


class Storage(Protocol):
    """One opened storage file; `fault` says why it is not whole, and is empty where it is."""

    channels: list[Channel]
    start_ns: int
    end_ns: int
    fault: str

    def messages(self, ids: Collection[int]) -> Iterator[RawMessage]:
        """Yield the messages of the channels named, in log order."""

    def close(self) -> None:
        """Release the file."""


def ros2_type(name: str) -> str:
    """Return a ROS 1 type name ("pkg/Type") in the ROS 2 form ("pkg/msg/Type")."""
    package, _, rest = name.partition("/")
    return name if "/" in rest or not rest else f"{package}/msg/{rest}"
