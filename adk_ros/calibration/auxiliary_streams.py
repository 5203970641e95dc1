# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pedals, wheel speeds and satellite receiver of a bag as streams, each from its topic."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from adk_ros.bags.auxiliary_topics import (
    AUXILIARY_TOPICS,
    FIX,
    GPS_FIX,
    GPS_SPEED,
    GPS_VELOCITY,
    PEDALS,
    WHEEL_TOPICS,
    topic_of,
)
from adk_ros.bags.reader import TopicInfo
from adk_ros.calibration.messages import stamp_s
from adk_ros.calibration.stream_table import stream_of, usable_rows
from adk_ros.calibration.streams import Stream

_PEDAL_TOPICS = {topic_of(pedal).name: pedal for pedal in PEDALS}
_WHEELS = {topic: at for at, topic in WHEEL_TOPICS.items()}
READ_TOPICS = frozenset({*_PEDAL_TOPICS, *_WHEELS, GPS_SPEED, GPS_VELOCITY, GPS_FIX})
"""Auxiliary topics that a check uses."""
_NO_FIX = -1
"""`status` of a NavSatFix without a position."""


def fix_topic(topics: Iterable[TopicInfo]) -> str | None:
    """Return the topic of satellite fixes: that of `adk import`, else the fullest one."""
    fixes = [x for x in topics if x.msgtype == FIX and x.count]
    fixes.sort(key=lambda x: (x.name != GPS_FIX, -x.count, x.name))
    return fixes[0].name if fixes else None


@dataclass
class AuxiliaryRows:
    """Rows of stamp, s, and values by topic; they grow message by message."""

    rows: dict[str, list[list[float]]] = field(default_factory=dict)

    def add(self, topic: str, msg: Any, log_ns: int) -> None:
        """
        Take over a message of one of `READ_TOPICS`, or a satellite fix of any topic.

        :raises AttributeError, TypeError, ValueError: it lacks a field.
        """
        if getattr(msg, "__msgtype__", "") == FIX:
            if int(msg.status.status) == _NO_FIX:
                return
            topic = GPS_FIX
        # A number without a header has the time of its log.
        at_s = stamp_s(msg) if hasattr(msg, "header") else 1e-9 * log_ns
        self.rows.setdefault(topic, []).append([at_s, *AUXILIARY_TOPICS[topic].values(msg)])

    def pedals(self, seconds: float, first_s: float) -> Mapping[str, Stream]:
        """Return the pedals and the gear by name, in the column "value"."""
        return self._named(_PEDAL_TOPICS, "value", seconds, first_s)

    def wheels(self, seconds: float, first_s: float) -> Mapping[str, Stream]:
        """Return the angular velocities by the position of the wheel or axle, rad/s."""
        return self._named(_WHEELS, "velocity", seconds, first_s)

    def gps_speed(self, seconds: float, first_s: float) -> Stream | None:
        """Return the speed over ground, m/s, in the column "gps_speed"."""
        for topic in (GPS_VELOCITY, GPS_SPEED):
            if (stream := self._stream(topic, "the GPS receiver", seconds, first_s)) is not None:
                return stream
        return None

    def gps_fix(self, seconds: float, first_s: float) -> Stream | None:
        """Return latitude and longitude, degrees, and altitude, m, by these names."""
        return self._stream(GPS_FIX, "the GPS receiver", seconds, first_s)

    def heights(
        self, odometry: list[list[float]], seconds: float, first_s: float
    ) -> Mapping[str, Stream]:
        """
        Return the heights that vary, m, by their source, in the column "height".

        :param odometry: stamp, s, and height of each message of odometry.
        """
        gps = [[row[0], row[3]] for row in self.rows.get(GPS_FIX, [])]
        titles = {"odometry": "odometry's z", "gps": "the GPS altitude"}
        out = {}
        for source, rows in (("odometry", odometry), ("gps", gps)):
            # A receiver without a height reports NaN: that is a gap, not a line between fixes.
            known = usable_rows([row for row in rows if math.isfinite(row[1])], seconds)
            stream = stream_of(titles[source], known, ("height",), first_s)
            if stream is not None and stream.has("height"):
                out[source] = stream
        return out

    def _named(
        self, names: Mapping[str, str], column: str, seconds: float, first_s: float
    ) -> dict[str, Stream]:
        out = {}
        for topic, name in names.items():
            found = usable_rows(self.rows.get(topic, []), seconds)
            if (stream := stream_of(name, found, (column,), first_s)) is not None:
                out[name] = stream
        return out

    def _stream(self, topic: str, name: str, seconds: float, first_s: float) -> Stream | None:
        found = usable_rows(self.rows.get(topic, []), seconds)
        return stream_of(name, found, AUXILIARY_TOPICS[topic].channels, first_s)
