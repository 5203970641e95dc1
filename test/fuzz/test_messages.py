# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Altered messages, in their fields and in their CDR bytes: the node's core and a running node.

Whatever arrives, nothing leaves that is not finite or that no vehicle could do, nothing is
raised, and after a while of good messages every tick is predicted again.
"""

import math
import random
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from geometry_msgs.msg import TwistWithCovarianceStamped
from helpers.fuzzing import (
    EXTREMES,
    NUMBERS,
    Edit,
    assert_one_line,
    byte_edits,
    edited_bytes,
    fuzz,
)
from helpers.node import Rig, running_node, write_model
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from adk_ros.model import artefact
from adk_ros.model.drivable import is_drivable
from adk_ros.model.koopman import KoopmanModel
from adk_ros.ros.messages import split_stamp
from adk_ros.ros.session import Session
from adk_ros.ros.traffic import KINDS, Rates, message, motion, schedule
from adk_ros.signals.channels import STANDARD_SOURCES, Reading, Source
from adk_ros.signals.decode import MAX_SPEED, MAX_YAW_RATE

pytestmark = pytest.mark.slow(seconds=20)
GOOD_S, FAULTY_S = 6.0, 1.0
"""s of good messages afterwards, more than the gate and the clock take to recover, and of bad."""


class Fault(NamedTuple):
    """What happens to every `every`-th message of a stream."""

    source: Source
    every: int
    action: str
    place: int
    value: Any
    edits: list[Edit]


FAULTS = st.builds(
    Fault,
    st.sampled_from(STANDARD_SOURCES),
    st.sampled_from([1, 2, 7, 20]),
    st.sampled_from(["field", "field", "bytes", "lose", "repeat", "stamp", "array"]),
    st.integers(0, 200),
    st.one_of(NUMBERS, st.sampled_from(EXTREMES)),
    byte_edits(),
)


def altered(fault: Fault, msg: Any) -> Any:
    """Return what a fault makes of a message: a message, a list of messages, or None."""
    if fault.action == "lose":
        return None
    if fault.action == "repeat":
        return [msg] * (2 + fault.place % 5)
    if fault.action == "bytes":
        try:
            return deserialize_message(
                edited_bytes(serialize_message(msg), fault.edits), type(msg)
            )
        except Exception:
            # rclpy drops such a message as well.
            return None
    if fault.action == "stamp":
        offset = fault.value if math.isfinite(fault.value) else 0.0
        stamp_ns = msg.header.stamp.sec * 10**9 + msg.header.stamp.nanosec
        shifted = stamp_ns + int(max(-1e19, min(offset * 1e9, 1e19)))
        msg.header.stamp.sec, msg.header.stamp.nanosec = split_stamp(
            max(-(2**31) * 10**9, min(shifted, (2**31 - 1) * 10**9))
        )
        return msg
    places = list(_numbers(msg))
    owner, name = places[fault.place % len(places)]
    number = float(fault.value)
    if fault.action == "array" and hasattr(msg, "position"):
        setattr(msg, ["position", "velocity", "effort"][fault.place % 3], [number] * fault.every)
    elif isinstance(name, int):
        owner[name] = number
    else:
        setattr(owner, name, number)
    return msg


def _numbers(msg: Any) -> Any:
    """Yield (owner, name or index) of the floats in a message."""
    for name, kind in msg.get_fields_and_field_types().items():
        value = getattr(msg, name)
        if kind == "double":
            yield msg, name
        elif "double" in kind:
            yield from ((value, i) for i in range(len(value)))
        elif hasattr(value, "get_fields_and_field_types"):
            yield from _numbers(value)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_model(tmp_path_factory.mktemp("fuzz") / "model")


@pytest.fixture(scope="module")
def model(folder: Path) -> KoopmanModel:
    return artefact.load(folder).model


def test_core(model: KoopmanModel) -> None:
    def check(faults: list[Fault]) -> None:
        rig, counts = Rig(model), dict.fromkeys(Source, 0)

        def change(source: Source, msg: Any) -> Any:
            counts[source] += 1
            for fault in faults:
                if source is fault.source and counts[source] % fault.every == 0:
                    out = altered(fault, msg)
                    if out is None or isinstance(out, list):
                        return out
                    msg = out
            return msg

        rig.drive(1.5)
        rig.drive(FAULTY_S, change)
        rig.drive(GOOD_S)
        published = len(rig.published)
        rig.drive(1.0)
        assert not rig.errors, rig.errors
        assert rig.all_finite()
        for prediction in rig.published:
            assert abs(prediction.x[:2]).max() <= MAX_SPEED
            assert abs(prediction.x[2]) <= MAX_YAW_RATE
            assert is_drivable(prediction.x, prediction.horizon)
        for report in rig.reports:
            assert_one_line(report.message)
            for key, value in report.values:
                assert_one_line(key)
                assert value.isprintable()
        assert len(rig.published) - published >= 38, rig.reports[-1]

    fuzz(st.lists(FAULTS, min_size=1, max_size=3), check)


def test_running_node(folder: Path) -> None:
    """A node that receives altered bytes by its topics lives on and predicts."""
    noise = random.Random(0)
    with running_node(model=str(folder)) as node, Session("fuzz") as session:
        # The middleware writes a line for each message that is none: nobody reads a full pipe.
        assert node.process.stderr is not None
        threading.Thread(target=node.process.stderr.read, daemon=True).start()
        received: list[Any] = []
        session.node.create_subscription(
            TwistWithCovarianceStamped, "/predictor/predicted_twist", received.append, 10
        )
        publishers = {
            source: session.node.create_publisher(kind, source.name.lower(), 10)
            for source, kind in KINDS.items()
        }
        end_s = time.monotonic() + 60.0
        while any(p.get_subscription_count() < 1 for p in publishers.values()):
            assert time.monotonic() < end_s
            session.spin(0.05)

        def publish(duration_s: float, faults: dict[Source, list[Edit]]) -> None:
            begin_ns, begin_s = time.time_ns(), time.monotonic()
            for due in schedule(Rates(), duration_s):
                while time.monotonic() - begin_s < due.offset_ns * 1e-9:
                    session.spin(0.001)
                values = motion(due.source, due.offset_ns * 1e-9, noise)
                reading = Reading(due.source, begin_ns + due.offset_ns, values)
                content = serialize_message(message(reading))
                if due.source in faults:
                    content = edited_bytes(content, faults[due.source])
                publishers[due.source].publish(content)

        def check(faults: dict[Source, list[Edit]]) -> None:
            publish(0.3, faults)
            assert node.process.poll() is None
            for twist in received:
                velocity = twist.twist.twist
                assert abs(velocity.linear.x) <= MAX_SPEED
                assert abs(velocity.linear.y) <= MAX_SPEED
                assert abs(velocity.angular.z) <= MAX_YAW_RATE
            received.clear()

        fuzz(st.dictionaries(st.sampled_from(STANDARD_SOURCES), byte_edits(2), min_size=1), check)
        publish(GOOD_S, {})
        received.clear()
        publish(1.0, {})
        assert len(received) >= 30
        assert node.end()[0] == 0
