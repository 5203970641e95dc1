# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Listens to the predictions of a running node: prints them, or keeps them.

People read km/h and deg/s, aligned; programs read JSON lines in SI units.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TextIO

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped

from adk_ros.errors import DataError, UsageError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.ros.messages import AXES, DIAGNOSTIC_NAME, join_stamp
from adk_ros.ros.session import Session, stopping
from adk_ros.signals.channels import STATE_NAMES

TOPIC_TYPE = "geometry_msgs/msg/TwistWithCovarianceStamped"
TOPIC_NAME = "predicted_twist"
_DEPTH = 2000
_KMH = 3.6
_DEG = 180.0 / math.pi


class ReceivedPrediction(NamedTuple):
    """A prediction as it arrived: SI units, `covariance` (3, 3), `arrival_ns` monotonic."""

    stamp_ns: int
    x: tuple[float, float, float]
    covariance: FloatArray
    arrival_ns: int


@dataclass
class PredictionLog:
    """All predictions heard, in order of arrival: n rows."""

    topic: str
    received: list[ReceivedPrediction] = field(default_factory=list)

    @property
    def stamp_ns(self) -> IntArray:
        """Times predicted for, (n,)."""
        return np.array([item.stamp_ns for item in self.received], dtype=np.int64)

    @property
    def arrival_ns(self) -> IntArray:
        """Monotonic times of arrival, (n,)."""
        return np.array([item.arrival_ns for item in self.received], dtype=np.int64)

    @property
    def x(self) -> FloatArray:
        """Predicted v_x, v_y, yaw rate, (n, 3)."""
        return np.array([item.x for item in self.received]).reshape(-1, 3)

    @property
    def covariance(self) -> FloatArray:
        """Their covariances, (n, 3, 3)."""
        return np.array([item.covariance for item in self.received]).reshape(-1, 3, 3)


def decode(message: Any, arrival_ns: int) -> ReceivedPrediction:
    """Return the content of a TwistWithCovarianceStamped."""
    twist = message.twist.twist
    covariance = np.asarray(message.twist.covariance, dtype=np.float64).reshape(6, 6)
    return ReceivedPrediction(
        stamp_ns=join_stamp(message.header.stamp),
        x=(twist.linear.x, twist.linear.y, twist.angular.z),
        covariance=covariance[np.ix_(AXES, AXES)],
        arrival_ns=arrival_ns,
    )


def listen(
    on_prediction: Callable[[ReceivedPrediction], None],
    topic: str | None = None,
    *,
    count: int | None = None,
    duration_s: float | None = None,
    idle_s: float | None = None,
    wait_s: float = 10.0,
    until: Callable[[], bool] | None = None,
    on_ready: Callable[[str], None] | None = None,
    on_node: Callable[[Any], None] | None = None,
) -> str:
    """
    Call `on_prediction` with each prediction; return the topic's name.

    :param topic: where to listen; by default the only predicted_twist there is.
    :param count: end after so many. :param duration_s: end so long after the first one.
    :param idle_s: end when none came for so long. :param until: end when this says so.
    :param wait_s: wait so long for a topic that somebody publishes, and for the first prediction
        no limit but `until` and signals.
    :param on_ready: called with the topic's name once the subscription has its publisher.
    :param on_node: called with the listening node at first, to subscribe to more than this.
    :raises UsageError: no such topic, or several. :raises DataError: `idle_s` without any.
    """
    arrivals = _Arrivals(on_prediction)
    with Session("adk_echo") as session, stopping() as stopped:

        def ended() -> bool:
            return stopped() or (until is not None and until())

        if on_node is not None:
            on_node(session.node)
        name = _find(session, topic, wait_s, ended)
        subscription = session.node.create_subscription(
            TwistWithCovarianceStamped, name, arrivals.take, _DEPTH
        )
        started_s = time.monotonic()
        ready = on_ready is None
        while not ended():
            if not ready and on_ready is not None and subscription.get_publisher_count():
                ready = True
                on_ready(subscription.topic_name)
            session.spin(0.05)
            if count is not None and arrivals.number >= count:
                break
            now_s = time.monotonic()
            first_s, last_s = arrivals.first_s, arrivals.last_s
            if first_s and duration_s is not None and now_s - first_s >= duration_s:
                break
            if idle_s is not None and now_s - (last_s or started_s) > idle_s:
                if not last_s:
                    raise DataError(f"{name}: no prediction within {idle_s:g} s")
                break
        return str(subscription.topic_name)


class _Arrivals:
    """Numbers what arrives."""

    def __init__(self, on_prediction: Callable[[ReceivedPrediction], None]) -> None:
        self._on_prediction = on_prediction
        self.number = 0
        self.first_s = 0.0
        self.last_s = 0.0

    def take(self, message: Any) -> None:
        """The subscription's callback."""
        arrival_ns = time.monotonic_ns()
        self.number += 1
        self.last_s = arrival_ns * 1e-9
        self.first_s = self.first_s or self.last_s
        self._on_prediction(decode(message, arrival_ns))


def _find(session: Session, topic: str | None, wait_s: float, ended: Callable[[], bool]) -> str:
    deadline_s = time.monotonic() + wait_s
    wanted = session.resolve(topic) if topic else None
    while True:
        known = dict(session.node.get_topic_names_and_types())
        found = sorted(
            name
            for name, types in known.items()
            if TOPIC_TYPE in types
            and name.rsplit("/", 1)[-1] == TOPIC_NAME
            and session.node.count_publishers(name)
        )
        if wanted and session.node.count_publishers(wanted):
            if TOPIC_TYPE not in known.get(wanted, [TOPIC_TYPE]):
                raise UsageError(f"{wanted} carries {known[wanted][0]}, not {TOPIC_TYPE}")
            return wanted
        if wanted is None and len(found) == 1:
            return str(found[0])
        if wanted is None and found:
            raise UsageError(f"several nodes predict: choose a topic: {', '.join(found)}")
        if ended():
            return wanted or TOPIC_NAME
        if time.monotonic() > deadline_s:
            others = f"; there is {', '.join(found)}" if found else ""
            raise UsageError(
                f"nobody publishes {wanted or 'a topic ' + TOPIC_NAME}{others}: is the node "
                "running, with the same ROS_DOMAIN_ID?"
            )
        time.sleep(0.05)


def record(
    topic: str | None = None,
    *,
    count: int | None = None,
    duration_s: float | None = None,
    idle_s: float | None = None,
    wait_s: float = 10.0,
    until: Callable[[], bool] | None = None,
    on_ready: Callable[[str], None] | None = None,
    on_node: Callable[[Any], None] | None = None,
) -> PredictionLog:
    """Keep all predictions; parameters and errors as `listen`."""
    recording = PredictionLog(topic or "")
    recording.topic = listen(
        recording.received.append,
        topic,
        count=count,
        duration_s=duration_s,
        idle_s=idle_s,
        wait_s=wait_s,
        until=until,
        on_ready=on_ready,
        on_node=on_node,
    )
    return recording


def echo(
    topic: str | None = None,
    *,
    count: int | None = None,
    duration_s: float | None = None,
    as_json: bool = False,
    every: int = 10,
    wait_s: float = 10.0,
    idle_s: float | None = None,
    until: Callable[[], bool] | None = None,
    out: TextIO | None = None,
) -> PredictionLog:
    """
    Print every `every`-th prediction as a line; return all that were heard.

    :param count: end after so many lines. :param as_json: JSON lines in SI units.
    :param out: where to, by default the standard output; the others as `listen`.
    :raises UsageError: `every` or `count` is not positive, and as `listen`.
    """
    if every < 1 or (count is not None and count < 1):
        raise UsageError("--every and --count must be 1 or more")
    stream = out or sys.stdout
    recording = PredictionLog(topic or "")

    def show(heard: ReceivedPrediction) -> None:
        number = len(recording.received)
        recording.received.append(heard)
        if number % every:
            return
        if not as_json and number % (25 * every) == 0:
            print(header(), file=stream)
        print(json_line(heard) if as_json else line(heard), file=stream, flush=True)

    heard_in_all = None if count is None else (count - 1) * every + 1
    recording.topic = listen(
        show,
        topic,
        count=heard_in_all,
        duration_s=duration_s,
        idle_s=idle_s,
        wait_s=wait_s,
        until=until,
    )
    return recording


def header() -> str:
    """Return the heading of the columns of `line`."""
    names = ("v_x km/h", "v_y km/h", "yaw deg/s")
    return f"{'time predicted for':>20}" + "".join(f"  {name:>15}" for name in names)


def line(heard: ReceivedPrediction) -> str:
    """Return a prediction for a person: value and standard deviation of each channel."""
    sigma = np.sqrt(np.diag(heard.covariance)).tolist()
    units = (_KMH, _KMH, _DEG)
    cells = [f"{x * u:8.2f} ±{s * u:5.2f}" for x, s, u in zip(heard.x, sigma, units, strict=True)]
    return (
        f"{heard.stamp_ns // 1_000_000_000:>16}.{heard.stamp_ns // 1_000_000 % 1000:03d}"
        + "".join(f"  {cell}" for cell in cells)
    )


def json_line(heard: ReceivedPrediction) -> str:
    """Return a prediction as one line of JSON, SI units."""
    content: dict[str, Any] = {"stamp_ns": heard.stamp_ns}
    content |= dict(zip(STATE_NAMES, heard.x, strict=True))
    content["covariance"] = heard.covariance.tolist()
    return json.dumps(content)


def watch_diagnostics(node: Any, shown: dict[str, str]) -> None:
    """Keep the newest diagnostics of a predictor in `shown`, with `level` and `message`."""

    def take(array: Any) -> None:
        for status in array.status:
            if status.name.endswith(DIAGNOSTIC_NAME):
                shown["level"] = str(status.level[0])
                shown["message"] = status.message
                shown.update({pair.key: pair.value for pair in status.values})

    node.create_subscription(DiagnosticArray, "/diagnostics", take, 10)
