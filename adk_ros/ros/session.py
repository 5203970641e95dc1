# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A separate ROS context for programs that play, listen or measure for a limited time.

Tests and the demo call such programs as functions, next to each other. So nothing global is
initialised, and signals end the loop instead of the process.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType, TracebackType
from typing import Any

from rclpy.context import Context
from rclpy.exceptions import NameValidationException
from rclpy.node import Node

from adk_ros.errors import UsageError, first_line


class Session:
    """
    Context manager for a node named `name` in `namespace`, and its executor.

    `polled`: messages are fetched by `received`, many at a time, which takes less time than an
    executor that wakes up for each (`adk bench watch --live`).
    """

    def __init__(self, name: str, namespace: str = "", *, polled: bool = False) -> None:
        self._context: Any = Context()
        self._name, self._namespace, self._polled = name, namespace, polled

    def __enter__(self) -> Session:
        self._context.init()
        # Not annotated in every version of rclpy.
        create: Any = Node
        try:
            self.node: Any = create(
                self._name, context=self._context, namespace=self._namespace or None
            )
        except NameValidationException:
            self._context.try_shutdown()
            raise UsageError(f"namespace '{self._namespace}' is no valid ROS name") from None
        make = make_waiting_executor if self._polled else make_executor
        self._executor = make(self._context)
        self._executor.add_node(self.node)
        return self

    def resolve(self, topic: str) -> str:
        """
        Return the full name of a topic.

        :raises UsageError: it is not a valid topic name.
        """
        try:
            return str(self.node.resolve_topic_name(topic))
        except (NameValidationException, RuntimeError) as error:
            # rcl appends a position in its source code.
            reason = first_line(error).split(", at /")[0].rstrip(":")
            raise UsageError(f"topic '{topic}': {reason}") from None

    def spin(self, timeout_s: float) -> None:
        """Handle received messages; wait at most `timeout_s` for the first."""
        self._executor.spin_once(timeout_s)

    @staticmethod
    def received(subscription: Any) -> Iterator[tuple[int, Any]]:
        """
        Yield time, ns, and content of the messages that wait in a subscription.

        The time is that of reception, or that of publication where the middleware tells only it.
        """
        while True:
            with subscription.handle:
                taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if taken is None:
                return
            content, about = taken
            yield int(about["received_timestamp"] or about["source_timestamp"]), content

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._executor.remove_node(self.node)
        self.node.destroy_node()
        self._executor.shutdown()
        self._context.try_shutdown()


def make_executor(context: Any = None) -> Any:
    """
    Return an events executor: it keeps the order of arrival across topics and is fastest.

    Returns a single-threaded executor if rclpy has no events executor, or if standard error is
    not a file, which the events executor requires.
    """
    try:
        from rclpy.experimental.events_executor import EventsExecutor

        return EventsExecutor(context=context)
    except (ImportError, io.UnsupportedOperation):
        return make_waiting_executor(context)


def make_waiting_executor(context: Any = None) -> Any:
    """Return a single-threaded executor, which leaves messages alone unless it is spun."""
    from rclpy.executors import SingleThreadedExecutor

    return SingleThreadedExecutor(context=context)


def message_class(msgtype: str, needed_by: str) -> Any:
    """
    Import a message class by its ROS name, pkg/msg/Name.

    :raises UsageError: its package is not installed; the message begins with `needed_by`.
    """
    package, _, name = msgtype.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise UsageError(
            f"{needed_by} needs the message {msgtype}, but the ROS package {package} is not "
            "installed"
        ) from None


@contextlib.contextmanager
def stopping() -> Iterator[Callable[[], bool]]:
    """
    Yield a function that returns whether SIGINT or SIGTERM came; restore the handlers afterwards.

    Only the main thread receives signals: in other threads the function always returns False.
    """
    received = threading.Event()

    def note(_number: int, _frame: FrameType | None) -> None:
        received.set()

    if threading.current_thread() is not threading.main_thread():
        yield received.is_set
        return
    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
