# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A topic of the node, and whether anybody reads it.

Asking a publisher for the number of its subscriptions takes 5 to 50 µs after a pause, when the
middleware's data have left the caches. The middleware reports changes instead.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, UnsupportedEventTypeError


class OutputTopic:
    """
    A publisher of messages of type `kind` on the topic `name` of a ROS node.

    `is_read`: somebody subscribes, as far as an executor that spins the node has seen; always true
    where the middleware does not report it. `send` publishes serialised messages.
    """

    def __init__(self, node: Any, kind: Any, name: str, depth: int) -> None:
        self.is_read = False
        callbacks: Any = PublisherEventCallbacks
        try:
            self._publisher = node.create_publisher(
                kind, name, depth, event_callbacks=callbacks(matched=self._on_matched)
            )
        except UnsupportedEventTypeError:
            self.is_read = True
            self._publisher = node.create_publisher(kind, name, depth)
        # `Publisher.publish` takes a fifth longer after a pause, to check the type of the message.
        self.send: Callable[[bytes], None] = self._publisher.handle.publish_raw

    def publish(self, message: Any) -> None:
        """Publish a message object."""
        self._publisher.publish(message)

    def _on_matched(self, status: Any) -> None:
        self.is_read = status.current_count > 0
