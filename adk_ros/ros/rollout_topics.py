# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The topics for controllers: rollouts of candidate commands, and the local linear model.

common_interfaces has no service with arrays of numbers, so a request and its answer are two
topics. A Float64MultiArray has no stamp either: the label of the axis of steps holds it.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from adk_ros.errors import UsageError
from adk_ros.model.prediction import Prediction
from adk_ros.model.rollout_requests import COLUMNS, RefusedRequest
from adk_ros.numerics.arrays import FloatArray
from adk_ros.ros.core import Core
from adk_ros.ros.messages import split_stamp
from adk_ros.ros.output_topic import OutputTopic

STEP = "step from "
"""Begin of the label of the axis of steps; the stamp of the sample follows, in seconds."""
REFUSED = "refused: "
"""Begin of the label of the second axis of an answer without states."""


class RolloutTopics:
    """Answers `~/roll_out/commands` on `~/roll_out/states`; publishes `~/local_linear_model`."""

    def __init__(self, node: Any, core: Core, depth: int) -> None:
        self._core = core
        self.subscription = node.create_subscription(
            Float64MultiArray, "~/roll_out/commands", self._on_commands, depth
        )
        self._states_out = OutputTopic(node, Float64MultiArray, "~/roll_out/states", depth)
        self._model_out = OutputTopic(node, Float64MultiArray, "~/local_linear_model", depth)

    def publish(self, prediction: Prediction) -> None:
        """Publish the local linear model of a prediction with a horizon, if somebody reads it."""
        pipeline = self._core.pipeline
        sample = pipeline.last_sample
        if not self._model_out.is_read or sample is None:
            return
        if prediction.origin_ns != sample.stamp_ns:
            return  # A later sample was complete at the same time: the predictor is there.
        commands = pipeline.planned.commands
        if commands is None:
            commands = np.repeat(np.array(sample.u)[None], len(prediction.horizon), axis=0)
        try:
            blocks = pipeline.predictor.linearized(commands).blocks()
        except UsageError:
            return
        labels = (step_label(prediction.origin_ns), "row", "column")
        self._model_out.publish(array_message(blocks, labels))

    def _on_commands(self, message: Any) -> None:
        with self._core.guarded():
            self._states_out.publish(self._answer(message))

    def _answer(self, message: Any) -> Any:
        label = message.layout.dim[0].label if message.layout.dim else ""
        try:
            shape = [dimension.size for dimension in message.layout.dim]
            outdated = self._core.outdated()
            stamp_ns, states = self._core.rollouts.answer(shape, message.data, outdated)
        except RefusedRequest as refusal:
            return array_message(np.empty((0, 0, 0)), (label, f"{REFUSED}{refusal}", ""))
        return array_message(states, (label, step_label(stamp_ns), " ".join(COLUMNS)))


def step_label(stamp_ns: int) -> str:
    """Return the label of an axis of steps that begins at a stamp."""
    seconds, nanoseconds = split_stamp(stamp_ns)
    return f"{STEP}{seconds}.{nanoseconds:09d}"


def array_message(values: FloatArray, labels: Sequence[str]) -> Any:
    """Return a Float64MultiArray, row-major, with a label for each axis."""
    message = Float64MultiArray()
    message.layout = MultiArrayLayout(
        dim=[
            MultiArrayDimension(
                label=label, size=values.shape[axis], stride=int(np.prod(values.shape[axis:]))
            )
            for axis, label in enumerate(labels)
        ]
    )
    # rclpy checks and copies each number of another sequence, which takes 20 times as long.
    message.data = array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())
    return message
