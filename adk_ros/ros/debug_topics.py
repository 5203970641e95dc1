# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Topics that people plot while tuning; each is filled only while somebody subscribes.

common_interfaces has no stamped number. Quantities with the units of a twist or an acceleration
are published as such, others as named values of a JointState.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import AccelStamped, TwistStamped
from sensor_msgs.msg import JointState

from adk_ros.model.prediction import Prediction
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import FloatArray
from adk_ros.ros.messages import split_stamp
from adk_ros.ros.output_topic import OutputTopic
from adk_ros.signals.channels import STATE_NAMES

JOINT = "all"
"""Name of the normalised innovation squared of all channels together."""


def normalised_innovation_squared(innovation: FloatArray, covariance: FloatArray) -> FloatArray:
    """
    Return e_i^2 / P_ii of each channel, then e^T P^-1 e of all (4,); NaN where unknown.

    Chi-square distributed with 1 and 3 degrees of freedom if P is right and e is normal.

    :param innovation: e (3,). :param covariance: P (3, 3) of the prediction of the same sample.
    """
    single = np.square(innovation) / np.diag(covariance)
    try:
        together = float(innovation @ np.linalg.solve(covariance, innovation))
    except np.linalg.LinAlgError:
        together = math.nan
    return np.array([*single, together])


class DebugTopics:
    """Publishers below ~/debug of a node; `publish` takes every prediction, in order."""

    def __init__(self, node: Any, frame_id: str, depth: int) -> None:
        self._frame_id = frame_id
        self._previous: Prediction | None = None

        def publisher(kind: Any, name: str) -> OutputTopic:
            return OutputTopic(node, kind, f"~/debug/{name}", depth)

        self._innovation = publisher(TwistStamped, "innovation")
        self._normalised = publisher(JointState, "normalised_innovation_squared")
        self._disturbance = publisher(AccelStamped, "disturbance")
        self._tick_time = publisher(JointState, "tick_time")

    def publish(
        self, prediction: Prediction, predictor: Predictor, tick_us: Sequence[float]
    ) -> None:
        """
        Publish what is subscribed to, stamped with the sample that the prediction starts from.

        The tick time is that of the previous sample, and stamped so: this one is not done.

        :param predictor: the source of the prediction. :param tick_us: latest processing times,
            µs.
        """
        previous, self._previous = self._previous, prediction
        if self._disturbance.is_read:
            acceleration = AccelStamped()
            _set(acceleration.accel, predictor.disturbance)
            self._send(self._disturbance, acceleration, prediction.origin_ns)
        if previous is None:
            return
        if self._tick_time.is_read and tick_us:
            times = JointState(name=["tick_time"], position=[tick_us[-1] * 1e-6])
            self._send(self._tick_time, times, previous.origin_ns)
        if not (self._innovation.is_read or self._normalised.is_read):
            return
        if previous.stamp_ns != prediction.origin_ns or not np.isfinite(prediction.innovation[0]):
            return
        if self._innovation.is_read:
            twist = TwistStamped()
            _set(twist.twist, prediction.innovation)
            self._send(self._innovation, twist, prediction.origin_ns)
        if self._normalised.is_read:
            squares = normalised_innovation_squared(prediction.innovation, previous.covariance)
            values = JointState(name=[*STATE_NAMES, JOINT], position=squares.tolist())
            self._send(self._normalised, values, prediction.origin_ns)

    def _send(self, publisher: OutputTopic, message: Any, stamp_ns: int) -> None:
        message.header.frame_id = self._frame_id
        message.header.stamp.sec, message.header.stamp.nanosec = split_stamp(stamp_ns)
        publisher.publish(message)


def _set(target: Any, values: FloatArray) -> None:
    """Write v_x, v_y, yaw rate, or their derivatives, to a Twist or an Accel."""
    target.linear.x, target.linear.y, target.angular.z = values.tolist()
