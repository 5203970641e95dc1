# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""With several predictors, `adk echo` asks which one, and listens to the one that is named."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from geometry_msgs.msg import TwistWithCovarianceStamped

from adk_ros.errors import UsageError
from adk_ros.ros.echo import record
from adk_ros.ros.session import Session


@contextmanager
def predicting(*names: str, delay_s: float = 0.0) -> Iterator[None]:
    """Publish v_x = index of the name on its topic, the second and later ones after a delay."""
    ended = threading.Event()

    def publish() -> None:
        begin_s = time.monotonic()
        with Session("cars") as session:
            publishers: list[Any] = []
            while not ended.wait(0.02):
                wanted = len(names) if time.monotonic() - begin_s > delay_s else 1
                for name in names[len(publishers) : wanted]:
                    topic = f"/{name}/predicted_twist"
                    kind = TwistWithCovarianceStamped
                    publishers.append(session.node.create_publisher(kind, topic, 10))
                for index, publisher in enumerate(publishers):
                    message = TwistWithCovarianceStamped()
                    message.twist.twist.linear.x = float(index)
                    publisher.publish(message)
                session.spin(0.0)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


CHOICE = "2 predictors run: choose one with --node /car1/predictor or --node /car2/predictor"


def test_two_predictors_are_refused_with_their_names() -> None:
    with predicting("car1/predictor", "car2/predictor"), pytest.raises(UsageError) as refused:
        record(count=100_000, duration_s=10.0, wait_s=10.0)
    assert str(refused.value) == CHOICE


def test_a_second_predictor_that_is_found_late_is_refused() -> None:
    with (
        predicting("car1/predictor", "car2/predictor", delay_s=3.0),
        pytest.raises(UsageError) as refused,
    ):
        record(count=100_000, duration_s=10.0, wait_s=10.0)
    assert str(refused.value) == CHOICE


@pytest.mark.parametrize("name", ["car2/predictor", "/car2/predictor"])
def test_the_named_predictor_is_received(name: str) -> None:
    with predicting("car1/predictor", "car2/predictor"):
        received = record(predictor=name, count=5, wait_s=10.0)
    assert received.topic == "/car2/predictor/predicted_twist"
    assert {prediction.x[0] for prediction in received.received} == {1.0}


def test_topic_and_node_exclude_each_other() -> None:
    with pytest.raises(UsageError, match="--topic and --node exclude each other"):
        record("/a", predictor="b")
