# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Receive the predictions of a running node: print or collect them.

Printed lines are in km/h and deg/s; JSON lines are in SI units.
"""

from __future__ import annotations

import itertools
import json
import math
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TextIO

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped
from trajectory_msgs.msg import MultiDOFJointTrajectory

from adk_ros.errors import DataError, UsageError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.ros.messages import AXES, DIAGNOSTIC_NAME, join_stamp
from adk_ros.ros.session import Session, stopping
from adk_ros.signals.channels import STATE_NAMES

TOPIC_TYPE = "geometry_msgs/msg/TwistWithCovarianceStamped"
TOPIC_NAME = "predicted_twist"
_DEPTH = 2000
"""Queue depth, messages: 50 s at 40 Hz, so that a slow consumer loses nothing."""
_DISCOVERY_S = 1.0
"""s of looking for a second predictor before the only one is taken: most nodes answer at once."""
_LATE_DISCOVERY_S = 4.0
"""s in which a second predictor may still be found; DDS discovery takes up to 3 s."""
_KMH = 3.6
_DEG = 180.0 / math.pi
_MOST_RETURNED = 1000
"""Printed predictions that are returned: it may print for days."""
_LINES_PER_HEADER = 25
"""Lines after which the header is printed again: about a terminal page."""


class ReceivedPrediction(NamedTuple):
    """A received prediction: SI units, `covariance` (3, 3), `arrival_ns` monotonic."""

    stamp_ns: int
    x: tuple[float, float, float]
    covariance: FloatArray
    arrival_ns: int


@dataclass
class PredictionLog:
    """Received predictions, in order of arrival."""

    topic: str
    received: list[ReceivedPrediction] = field(default_factory=list)

    @property
    def stamp_ns(self) -> IntArray:
        """Predicted times, (n,)."""
        return np.array([item.stamp_ns for item in self.received], dtype=np.int64)

    @property
    def arrival_ns(self) -> IntArray:
        """Monotonic arrival times, (n,)."""
        return np.array([item.arrival_ns for item in self.received], dtype=np.int64)

    @property
    def x(self) -> FloatArray:
        """Predicted v_x, v_y, yaw rate, (n, 3)."""
        return np.array([item.x for item in self.received]).reshape(-1, 3)

    @property
    def covariance(self) -> FloatArray:
        """Covariances of the predictions, (n, 3, 3)."""
        return np.array([item.covariance for item in self.received]).reshape(-1, 3, 3)


def decode(message: Any, arrival_ns: int) -> ReceivedPrediction:
    """Return the prediction in a TwistWithCovarianceStamped."""
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
    predictor: str | None = None,
    count: int | None = None,
    duration_s: float | None = None,
    idle_s: float | None = None,
    wait_s: float = 10.0,
    until: Callable[[], bool] | None = None,
    on_ready: Callable[[str], None] | None = None,
    on_node: Callable[[Any], None] | None = None,
) -> str:
    """
    Call `on_prediction` with each prediction; return the name of the topic.

    :param topic: topic to subscribe to; default: the only predicted_twist that is published.
    :param predictor: name of the node to listen to, instead of a topic.
    :param count: number of predictions after which to end.
    :param duration_s: time after the first prediction at which to end, s.
    :param idle_s: time without a prediction after which to end, s.
    :param wait_s: longest wait for a publisher, s; then only `until` or a signal ends the wait
        for the first prediction.
    :param until: end as soon as this returns True.
    :param on_ready: called with the topic name once the subscription has a publisher.
    :param on_node: called with the subscribing node first, to add further subscriptions.
    :raises UsageError: no such topic, or several.
    :raises DataError: no prediction within `idle_s`.
    """
    if topic is not None and predictor is not None:
        raise UsageError("--topic and --node exclude each other: give one of them")
    if predictor is not None:
        topic = f"/{predictor.strip('/')}/{TOPIC_NAME}"
    arrivals = _Arrivals(on_prediction)
    with Session("adk_echo") as session, stopping() as stopped:

        def ended() -> bool:
            return stopped() or (until is not None and until())

        if on_node is not None:
            on_node(session.node)
        name = _wait_for_publisher(session, topic, wait_s, ended)
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
            if topic is None and time.monotonic() - started_s < _LATE_DISCOVERY_S:
                _require_one(_predictors(session))
            if count is not None and arrivals.count >= count:
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
    """Counts the predictions that arrive, with the times of the first and the last."""

    def __init__(self, on_prediction: Callable[[ReceivedPrediction], None]) -> None:
        self._on_prediction = on_prediction
        self.count = 0
        self.first_s = 0.0
        self.last_s = 0.0

    def take(self, message: Any) -> None:
        """Process a message; the callback of the subscription."""
        arrival_ns = time.monotonic_ns()
        self.count += 1
        self.last_s = arrival_ns * 1e-9
        self.first_s = self.first_s or self.last_s
        self._on_prediction(decode(message, arrival_ns))


def _wait_for_publisher(
    session: Session, topic: str | None, wait_s: float, ended: Callable[[], bool]
) -> str:
    """Return the name of the topic to subscribe to, once it has a publisher."""
    begin_s = time.monotonic()
    deadline_s = begin_s + wait_s
    resolved = session.resolve(topic) if topic else None
    while True:
        known = dict(session.node.get_topic_names_and_types())
        found = _predictors(session)
        if resolved and session.node.count_publishers(resolved):
            if TOPIC_TYPE not in known.get(resolved, [TOPIC_TYPE]):
                raise UsageError(f"{resolved} carries {known[resolved][0]}, not {TOPIC_TYPE}")
            return resolved
        if resolved is None:
            _require_one(found)
            if found and time.monotonic() - begin_s >= min(_DISCOVERY_S, wait_s):
                return found[0]
        if ended():
            return resolved or TOPIC_NAME
        if time.monotonic() > deadline_s:
            others = f"; available: {', '.join(found)}" if found else ""
            raise UsageError(
                f"no node publishes {resolved or 'a topic ' + TOPIC_NAME}{others}: check that the "
                "predictor runs with the same ROS_DOMAIN_ID"
            )
        time.sleep(0.05)


def _predictors(session: Session) -> list[str]:
    """Return the topics on which nodes predict, sorted."""
    node = session.node
    return sorted(
        str(name)
        for name, types in node.get_topic_names_and_types()
        if TOPIC_TYPE in types
        and name.rsplit("/", 1)[-1] == TOPIC_NAME
        and node.count_publishers(name)
    )


def _require_one(topics: list[str]) -> None:
    if len(topics) > 1:
        names = " or ".join(f"--node {topic.rpartition('/')[0]}" for topic in topics)
        raise UsageError(f"{len(topics)} predictors run: choose one with {names}")


def record(
    topic: str | None = None,
    *,
    predictor: str | None = None,
    count: int | None = None,
    duration_s: float | None = None,
    idle_s: float | None = None,
    wait_s: float = 10.0,
    until: Callable[[], bool] | None = None,
    on_ready: Callable[[str], None] | None = None,
    on_node: Callable[[Any], None] | None = None,
) -> PredictionLog:
    """Return all received predictions; parameters and errors as in `listen`."""
    recording = PredictionLog(topic or "")
    recording.topic = listen(
        recording.received.append,
        topic,
        predictor=predictor,
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
    predictor: str | None = None,
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
    Print every `every`-th prediction as a line; return the latest printed ones.

    :param count: number of lines after which to end.
    :param as_json: print JSON lines in SI units.
    :param out: stream to print to; default: standard output. Other parameters as in `listen`.
    :raises UsageError: `every` or `count` is not positive, and as `listen`.
    """
    if every < 1 or (count is not None and count < 1):
        raise UsageError("--every and --count must be 1 or more")
    stream = out or sys.stdout
    printed: deque[ReceivedPrediction] = deque(maxlen=_MOST_RETURNED)
    numbers = itertools.count()

    def show(prediction: ReceivedPrediction) -> None:
        number = next(numbers)
        if number % every:
            return
        printed.append(prediction)
        if not as_json and number % (_LINES_PER_HEADER * every) == 0:
            print(header(), file=stream)
        print(json_line(prediction) if as_json else line(prediction), file=stream, flush=True)

    messages = None if count is None else (count - 1) * every + 1
    name = listen(
        show,
        topic,
        predictor=predictor,
        count=messages,
        duration_s=duration_s,
        idle_s=idle_s,
        wait_s=wait_s,
        until=until,
    )
    return PredictionLog(name, list(printed))


def header() -> str:
    """Return the column header for `line`."""
    names = ("v_x km/h", "v_y km/h", "yaw deg/s")
    return f"{'time predicted for':>20}" + "".join(f"  {name:>15}" for name in names)


def line(prediction: ReceivedPrediction) -> str:
    """Return a prediction as text: value ± standard deviation of each channel."""
    sigma = np.sqrt(np.diag(prediction.covariance)).tolist()
    units = (_KMH, _KMH, _DEG)
    columns = [
        f"{x * u:8.2f} ±{s * u:5.2f}" for x, s, u in zip(prediction.x, sigma, units, strict=True)
    ]
    return (
        f"{prediction.stamp_ns // 1_000_000_000:>16}.{prediction.stamp_ns // 1_000_000 % 1000:03d}"
        + "".join(f"  {column}" for column in columns)
    )


def json_line(prediction: ReceivedPrediction) -> str:
    """Return a prediction as one JSON line, SI units."""
    content: dict[str, Any] = {"stamp_ns": prediction.stamp_ns}
    content |= dict(zip(STATE_NAMES, prediction.x, strict=True))
    content["covariance"] = prediction.covariance.tolist()
    return json.dumps(content)


def watch_diagnostics(node: Any, shown: dict[str, str]) -> None:
    """Write the latest diagnostics of a predictor to `shown`, with `level` and `message`."""

    def take(array: Any) -> None:
        for status in array.status:
            if status.name.endswith(DIAGNOSTIC_NAME):
                shown["level"] = str(status.level[0])
                shown["message"] = status.message
                shown.update({pair.key: pair.value for pair in status.values})

    node.create_subscription(DiagnosticArray, "/diagnostics", take, 10)


def time_horizons(node: Any, predictor: str, arrival_ns: list[int]) -> None:
    """
    Append the monotonic time of arrival of each horizon of a predictor to `arrival_ns`.

    The messages stay serialised: to decode 80 points would delay the predictions that follow.
    """

    def take(_content: bytes) -> None:
        arrival_ns.append(time.monotonic_ns())

    topic = f"{predictor}/predicted_horizon"
    node.create_subscription(MultiDOFJointTrajectory, topic, take, _DEPTH, raw=True)
