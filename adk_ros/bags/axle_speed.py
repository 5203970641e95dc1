# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed of an axle as one stream of messages, from the topics of its wheels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from adk_ros.bags.auxiliary_topics import stamp_ns_of

_MAX_APART_NS = 150_000_000
"""ns between the stamps of two wheels above which they are not of one moment: the longest gap over
which readings are interpolated (`signals.record`)."""


class AxleSpeed:
    """
    Joins TwistStamped messages of single wheels: their mean, once each has sent a new one.

    The wheels of an axle run half the track times the yaw rate slower and faster than its middle,
    which cancels in the mean. Speeds and stamps are averaged: wheels may report one after another.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self._topics = tuple(topics)
        self._waiting: dict[str, tuple[int, Any]] = {}

    def add(self, topic: str, log_ns: int, msg: Any) -> Any | None:
        """Return the message of the axle that a message of a wheel completes, if it does."""
        stamp_ns = stamp_ns_of(msg, log_ns)
        self._waiting[topic] = (stamp_ns, msg)
        self._waiting = {
            name: waiting
            for name, waiting in self._waiting.items()
            if abs(stamp_ns - waiting[0]) <= _MAX_APART_NS
        }
        if len(self._waiting) < len(self._topics):
            return None
        stamps = [stamp for stamp, _ in self._waiting.values()]
        speeds = [float(wheel.twist.angular.y) for _, wheel in self._waiting.values()]
        self._waiting = {}
        msg.twist.angular.y = sum(speeds) / len(speeds)
        stamp = msg.header.stamp
        stamp.sec, stamp.nanosec = divmod(sum(stamps) // len(stamps), 10**9)
        return msg
