# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The topics for planners: planned commands in; what follows them, and the predicted path, out.

Outputs are filled only while somebody subscribes.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from adk_ros.errors import UsageError
from adk_ros.model.pose_horizon import CarriedPose, pose_covariance, pose_horizon
from adk_ros.model.prediction import Prediction
from adk_ros.numerics.arrays import FloatArray
from adk_ros.ros.core import Core
from adk_ros.ros.messages import StampedCovarianceBytes, join_stamp, split_stamp
from adk_ros.ros.output_topic import OutputTopic
from adk_ros.ros.path_message import PathBytes
from adk_ros.ros.session import message_class
from adk_ros.signals.channels import INPUT_NAMES, TICK_NS, Source
from adk_ros.signals.command_plan import plan_types
from adk_ros.signals.frames import odometry_covariance, odometry_velocity, pose_of

POSE_NAMES = ("x", "y", "yaw")
_TICK_S = TICK_NS * 1e-9


class PlanTopics:
    """
    Subscribes to `planned_command`; publishes `~/predicted_path` and what belongs to it.

    `odometry` is the latest message. The path begins at its pose, or where its reading is not
    used, as with a wrong stamp, at the pose of the latest one that was, carried forward.

    :param frame_id: frame of the predictions. :param qos: of the subscription.
    """

    def __init__(self, node: Any, core: Core, frame_id: str, depth: int, qos: Any) -> None:
        self.odometry: Any = None
        self._used: tuple[int, Any] | None = None
        self._carried = CarriedPose()
        self._core, self._frame_id = core, frame_id
        settings = core.pipeline.settings
        self._steps = settings.horizon_steps
        # Beyond, nothing is predicted from odometry.
        self._oldest_s = settings.odometry_timeout_s + settings.max_coast_s
        self._path: PathBytes | None = None
        self._covariance: StampedCovarianceBytes | None = None
        kind = _first_installed(plan_types(core.sensors.command_type))
        self.subscription = node.create_subscription(kind, "planned_command", core.on_plan, qos)
        self._path_out = OutputTopic(node, Path, "~/predicted_path", depth)
        self._covariance_out = OutputTopic(
            node, JointTrajectory, "~/predicted_path_covariance_stamped", depth
        )
        self._plan_out = OutputTopic(node, JointState, "~/predicted_horizon_plan", depth)

    def publish(self, prediction: Prediction) -> None:
        """Publish what is subscribed to, of a prediction with a horizon."""
        if self._plan_out.is_read:
            label = JointState(
                name=list(INPUT_NAMES), position=[n * _TICK_S for n in prediction.planned_steps]
            )
            label.header.frame_id = self._frame_id
            label.header.stamp.sec, label.header.stamp.nanosec = split_stamp(prediction.origin_ns)
            self._plan_out.publish(label)
        if self._path_out.is_read or self._covariance_out.is_read:
            self._publish_path(prediction)

    def _publish_path(self, prediction: Prediction) -> None:
        """Publish the poses of odometry's frame of the vehicle along the horizon."""
        self._note_used()
        if self._used is None:
            return
        stamp_ns, message = self._used
        start = np.array(pose_of(message))
        after_s = (prediction.origin_ns - stamp_ns) * 1e-9
        if not (np.isfinite(start).all() and abs(after_s) <= self._oldest_s):
            return
        present = self._at_base(self._core.pipeline.predictor.present_state[None])[0]
        horizon = self._at_base(prediction.horizon)
        pose = self._carried.at(prediction.origin_ns, present, stamp_ns, start)
        poses = pose_horizon(pose, present, horizon)
        fixed_frame = str(message.header.frame_id)
        if self._path is None or self._path.frame_id != fixed_frame:
            self._path = PathBytes(fixed_frame, self._steps)
            self._covariance = StampedCovarianceBytes(fixed_frame, self._steps, POSE_NAMES)
        if self._path_out.is_read:
            z = float(message.pose.pose.position.z)
            # Localisation in a plane may have none.
            height = z if math.isfinite(z) else 0.0
            self._path_out.send(self._path.fill(prediction.origin_ns, poses, height))
        if self._covariance_out.is_read and self._covariance is not None:
            sensors = self._core.sensors
            at_base = odometry_covariance(
                prediction.horizon_covariance, sensors.reference_point, sensors.odometry_rotation
            )
            covariance = pose_covariance(poses, horizon, at_base)
            self._covariance_out.send(self._covariance.fill(prediction.origin_ns, covariance))

    def _note_used(self) -> None:
        """Keep the latest message of odometry if its reading is used."""
        message = self.odometry
        if message is None or not hasattr(message, "pose"):
            return
        delay_ns = self._core.sensors.delays_ns[Source.ODOMETRY]
        stamp_ns = join_stamp(message.header.stamp) - delay_ns
        if self._core.pipeline.aligner.streams[Source.ODOMETRY].has(stamp_ns):
            self._used = stamp_ns, message

    def _at_base(self, velocities: FloatArray) -> FloatArray:
        """Return velocities (n, 3) at the origin of odometry's child frame, in its axes."""
        sensors = self._core.sensors
        return odometry_velocity(velocities, sensors.reference_point, sensors.odometry_rotation)


def _first_installed(msgtypes: tuple[str, ...]) -> Any:
    for msgtype in msgtypes[:-1]:
        try:
            return message_class(msgtype, "planned_command")
        except UsageError:
            continue
    return message_class(msgtypes[-1], "planned_command")
