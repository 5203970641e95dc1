# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ask a running node for rollouts of candidate commands, as a planner in another process does."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray

from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.ros.rollout_topics import REFUSED, array_message
from adk_ros.ros.session import Session

_ANSWER_S = 1.0
"""s to wait for an answer."""


class RolloutClient:
    """Asks the node `node_name` in a session, one request at a time."""

    def __init__(self, session: Session, node_name: str = "/predictor") -> None:
        self._session = session
        self._answers: list[Any] = []
        create = session.node
        self._requests = create.create_publisher(
            Float64MultiArray, f"{node_name}/roll_out/commands", 1
        )
        create.create_subscription(
            Float64MultiArray, f"{node_name}/roll_out/states", self._answers.append, 10
        )
        self._sent = 0

    def ask(self, commands: FloatArray) -> FloatArray | None:
        """Return the answer (k, h, 4) to `commands` (k, h, 2), None if there is none in time."""
        self._sent += 1
        label = f"request {self._sent}"
        self._answers.clear()
        self._requests.publish(array_message(commands, (label, "step", "torque delta")))
        deadline_s = time.monotonic() + _ANSWER_S
        while time.monotonic() < deadline_s:
            self._session.spin(0.05)
            for answer in self._answers:
                id_axis, step_axis, _ = answer.layout.dim
                if id_axis.label == label and not step_axis.label.startswith(REFUSED):
                    return np.asarray(answer.data).reshape(*commands.shape[:2], -1)
        return None

    def times_ms(
        self, commands: FloatArray, requests: int, pause_s: float, timeout_s: float
    ) -> FloatArray:
        """
        Return the round trips (requests,), ms, with pauses between them.

        :raises DataError: no answer within `timeout_s`.
        """
        end_s = time.monotonic() + timeout_s
        # The first one finds the node.
        while self.ask(commands) is None:
            if time.monotonic() > end_s:
                raise DataError("the node does not answer requests for rollouts")
        out: list[float] = []
        while len(out) < requests:
            time.sleep(pause_s)
            begin = time.perf_counter()
            if self.ask(commands) is not None:
                out.append(1e3 * (time.perf_counter() - begin))
            elif time.monotonic() > end_s + requests * _ANSWER_S:
                raise DataError("the node has stopped answering requests for rollouts")
        return np.array(out)
