# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Replay a bag through the predictor without ROS: the predictions of the live node."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bags import Bag, BagWriter, message
from adk_ros.bags.recording import (
    RecordingOptions,
    choose_topics,
    messages_of,
    plan_topic,
    source_by_topic,
)
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.pipeline import Pipeline, PipelineSettings
from adk_ros.model.prediction import Prediction
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.frames import published_frame
from adk_ros.signals.velocity_messages import ODOMETRY_TYPES

TWIST_TOPIC = "/predictor/predicted_twist"
HORIZON_TOPIC = "/predictor/predicted_horizon"
COVARIANCE_TOPIC = "/predictor/predicted_horizon_covariance"
TWIST_TYPE = "geometry_msgs/msg/TwistWithCovarianceStamped"
HORIZON_TYPE = "trajectory_msgs/msg/MultiDOFJointTrajectory"
COVARIANCE_TYPE = "std_msgs/msg/Float64MultiArray"
_PLANAR_AXES = (0, 1, 5)
"""Rows and columns of v_x, v_y and yaw rate in the 6 x 6 covariance of a twist."""
_NOT_ESTIMATED = 1e6
"""Variance of the other axes, SI units squared, as in `ros.messages`."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class ReplayOutput:
    """
    Bag to write: the predicted twists, the odometry, and optionally the horizons.

    `frame_id`: the node's parameter of that name, the frame of the predictions.
    """

    path: Path
    with_horizon: bool = False
    frame_id: str = ""


def predictions(
    bag: Bag,
    pipeline: Pipeline,
    options: RecordingOptions,
    progress: Progress | None = None,
) -> Iterator[tuple[int, Prediction]]:
    """
    Yield (log time in ns of the message that completed the sample, prediction), in order.

    Horizons follow the planned commands of the bag, if it has any.
    """
    topics = choose_topics(bag, options)
    source_of = source_by_topic(topics)
    plan = plan_topic(bag, options.sensors.command_type)
    for topic, log_ns, msg in messages_of(bag, topics, [plan] if plan else [], progress):
        if topic == plan:
            pipeline.take_plan(msg)
            continue
        for prediction in pipeline.take(source_of[topic], msg):
            yield log_ns, prediction


def replay(
    path: Path,
    model: KoopmanModel,
    settings: PipelineSettings,
    options: RecordingOptions,
    output: ReplayOutput | None = None,
    progress: Progress | None = None,
) -> tuple[list[Prediction], Pipeline, list[str]]:
    """
    Replay a bag; return the predictions, the pipeline with its counts, and the bag's warnings.

    The returned predictions have an empty `horizon_covariance`, which would take 0.8 GB per hour.

    :param output: bag to write, with the predicted twists and the measured odometry.
    :raises UsageError, DataError: the bag cannot be read, or the output cannot be written.
    """
    pipeline = Pipeline(model, settings)
    made: list[Prediction] = []
    with Bag(path) as bag:
        stream = predictions(bag, pipeline, options, progress)
        if output is None:
            made = [_without_covariance(prediction) for _, prediction in stream]
        else:
            odometry = choose_topics(bag, options).odometry
            with BagWriter(output.path, "mcap", "zstd") as writer:
                writer.add_topic(TWIST_TOPIC, TWIST_TYPE)
                writer.add_topic(odometry, ODOMETRY_TYPES[options.sensors.odometry_type].msgtype)
                if output.with_horizon:
                    writer.add_topic(HORIZON_TOPIC, HORIZON_TYPE)
                    writer.add_topic(COVARIANCE_TOPIC, COVARIANCE_TYPE)
                for topic, _, log_ns, content in bag.raw([odometry]):
                    writer.write(topic, content, log_ns)
                point = settings.sensors.reference_point
                frame_id = published_frame(output.frame_id, point)
                for log_ns, prediction in stream:
                    made.append(_without_covariance(prediction))
                    writer.write(TWIST_TOPIC, twist_message(prediction, frame_id), log_ns)
                    if output.with_horizon:
                        writer.write(HORIZON_TOPIC, horizon_message(prediction, frame_id), log_ns)
                        writer.write(COVARIANCE_TOPIC, covariance_message(prediction), log_ns)
        warnings = list(bag.warnings)
    if model.lifting.warning:
        warnings.append(model.lifting.warning)
    return made, pipeline, warnings


def _without_covariance(prediction: Prediction) -> Prediction:
    return prediction._replace(horizon_covariance=np.zeros((0, 3, 3)))


def twist_message(prediction: Prediction, frame_id: str = "base_link") -> Any:
    """Return the predicted twist as the node publishes it, stamped with the predicted time."""
    covariance = [0.0] * 36
    for axis in range(6):
        covariance[7 * axis] = _NOT_ESTIMATED
    for i, row in enumerate(_PLANAR_AXES):
        for j, column in enumerate(_PLANAR_AXES):
            covariance[6 * row + column] = float(prediction.covariance[i, j])
    return message(
        TWIST_TYPE,
        header={"stamp": prediction.stamp_ns, "frame_id": frame_id},
        twist={"twist": _twist(prediction.x), "covariance": covariance},
    )


def horizon_message(prediction: Prediction, frame_id: str = "base_link") -> Any:
    """Return the horizon as the node publishes it, stamped with its origin."""
    step_ns = prediction.stamp_ns - prediction.origin_ns
    points = [
        {
            "velocities": [message("geometry_msgs/msg/Twist", **_twist(x))],
            "time_from_start": {
                "sec": step_ns * (i + 1) // 10**9,
                "nanosec": step_ns * (i + 1) % 10**9,
            },
        }
        for i, x in enumerate(prediction.horizon)
    ]
    return message(
        HORIZON_TYPE,
        header={"stamp": prediction.origin_ns, "frame_id": frame_id},
        joint_names=["vehicle"],
        points=[message("trajectory_msgs/msg/MultiDOFJointTrajectoryPoint", **p) for p in points],
    )


def covariance_message(prediction: Prediction) -> Any:
    """Return the covariance along the horizon (steps, 3, 3) as the node publishes it."""
    steps = len(prediction.horizon_covariance)
    dims = (("step", steps, 9 * steps), ("row", 3, 9), ("column", 3, 3))
    return message(
        COVARIANCE_TYPE,
        layout={
            "dim": [
                message("std_msgs/msg/MultiArrayDimension", label=label, size=size, stride=stride)
                for label, size, stride in dims
            ],
            "data_offset": 0,
        },
        data=np.ascontiguousarray(prediction.horizon_covariance).ravel(),
    )


def _twist(x: FloatArray) -> dict[str, Any]:
    return {
        "linear": {"x": float(x[0]), "y": float(x[1])},
        "angular": {"z": float(x[2])},
    }
