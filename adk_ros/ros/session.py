# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A ROS context of one's own, for a program that only plays, listens or measures for a while.

Such programs are also functions that a test or the demo calls, next to others: so nothing global
is initialised, and signals end the loop instead of the process.
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

from adk_ros.errors import UsageError


class Session:
    """A context manager: a node named `name` and its executor, gone at the end."""

    def __init__(self, name: str) -> None:
        self._context: Any = Context()
        self._name = name

    def __enter__(self) -> Session:
        self._context.init()
        # Not annotated in every version of rclpy.
        make: Any = Node
        self.node: Any = make(self._name, context=self._context)
        self._executor = make_executor(self._context)
        self._executor.add_node(self.node)
        return self

    def resolve(self, topic: str) -> str:
        """
        Return the full name of a topic.

        :raises UsageError: it is no name that a topic may have.
        """
        try:
            return str(self.node.resolve_topic_name(topic))
        except (NameValidationException, RuntimeError) as error:
            # rcl adds where in its own source it noticed.
            reason = str(error).splitlines()[0].split(", at /")[0].rstrip(":")
            raise UsageError(f"topic '{topic}': {reason}") from None

    def spin(self, timeout_s: float) -> None:
        """Handle what has come, waiting at most so long for the first of it."""
        self._executor.spin_once(timeout_s)

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
    Return an events executor, which keeps the order of arrival across topics and costs least.

    Where rclpy has none, or the standard error is no file (it wants to leave its last words
    there), the single-threaded one does.
    """
    try:
        from rclpy.experimental.events_executor import EventsExecutor

        return EventsExecutor(context=context)
    except (ImportError, io.UnsupportedOperation):
        from rclpy.executors import SingleThreadedExecutor

        return SingleThreadedExecutor(context=context)


def message_class(msgtype: str, why: str) -> Any:
    """
    Import a message class by its ROS name, pkg/msg/Name.

    :raises UsageError: its package is not installed; `why` says what needs it.
    """
    package, _, name = msgtype.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise UsageError(
            f"{why} needs the message {msgtype}, but the ROS package {package} is not installed"
        ) from None


@contextlib.contextmanager
def stopping() -> Iterator[Callable[[], bool]]:
    """
    Yield a function that says whether SIGINT or SIGTERM came; what was in force comes back after.

    Signals reach the main thread alone: in another one the function always says no.
    """
    came = threading.Event()

    def note(_number: int, _frame: FrameType | None) -> None:
        came.set()

    if threading.current_thread() is not threading.main_thread():
        yield came.is_set
        return
    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield came.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
