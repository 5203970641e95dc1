# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node `predictor`: topics, service, timers. `ros.core` processes the messages."""

from __future__ import annotations

import gc
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TwistWithCovarianceStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from adk_ros.model import artefact
from adk_ros.model.pipeline import Pipeline
from adk_ros.model.prediction import Prediction
from adk_ros.model.stored_model import ARRAYS
from adk_ros.model.training_range import TrainingRange
from adk_ros.ros.core import Core, warm_up
from adk_ros.ros.debug_topics import DebugTopics
from adk_ros.ros.diagnostic_values import Clocks
from adk_ros.ros.diagnostics import Diagnostics, Level
from adk_ros.ros.messages import (
    DIAGNOSTIC_NAME,
    CovarianceBytes,
    HorizonBytes,
    StampedCovarianceBytes,
    TwistBytes,
)
from adk_ros.ros.output_topic import OutputTopic
from adk_ros.ros.parameter_settings import (
    differences_from_training,
    model_path,
    pipeline_settings,
    public_keys_path,
)
from adk_ros.ros.parameters import declare_parameters, unknown_parameters
from adk_ros.ros.plan_topics import PlanTopics
from adk_ros.ros.rollout_topics import RolloutTopics
from adk_ros.ros.session import message_class
from adk_ros.ros.starting import reporting_start
from adk_ros.ros.static_transforms import ImuExtrinsics
from adk_ros.ros.waiting import waiting_hint
from adk_ros.signals.channels import TICK_NS, Source
from adk_ros.signals.commands import COMMAND_TYPES
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.frames import published_frame
from adk_ros.signals.velocity_messages import ODOMETRY_TYPES

NODE_NAME = "predictor"
INPUT_DEPTH = 200
"""Queue depth of the subscriptions, messages: 0.2 s of an IMU at 1000 Hz."""
_WAIT_S = 5.0
"""s without a message after which the log says what is published instead; discovery takes 3 s."""
_ODOMETRY = Source.ODOMETRY
_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
"""What rmw calls a node that it has not discovered."""
OUTPUT_DEPTH = 10
"""Queue depth of the publishers, messages: the default of ROS 2."""


class PredictorNode:
    """
    Subscribe to imu, odometry and command; publish predictions and diagnostics.

    `node` is the ROS node that an executor spins.
    :raises UsageError: a parameter does not fit, or the model is refused.
    """

    def __init__(self) -> None:
        # rclpy is only partly annotated.
        create: Any = Node
        self.node: Any = create(NODE_NAME)
        self._logger: Any = self.node.get_logger()
        self.values = declare_parameters(self.node)
        for text in unknown_parameters(self.node):
            self._logger.warning(text)
        path = model_path(self.values)
        self._logger.info(f"loading {path}; the first start compiles kernels (some seconds)")
        self._clock = self.node.get_clock()
        self._name = self.node.get_fully_qualified_name().lstrip("/")
        self._diagnostics_out = self.node.create_publisher(
            DiagnosticArray, "/diagnostics", OUTPUT_DEPTH
        )
        kind = COMMAND_TYPES[self.values["command_type"]]
        needed_by = f"command_type '{self.values['command_type']}'"
        velocity = ODOMETRY_TYPES[self.values["odometry_type"]]
        classes = {
            Source.ODOMETRY: message_class(velocity.msgtype, "odometry_type"),
            Source.COMMAND: message_class(kind.msgtype, needed_by),
        }
        if kind.steering_msgtype is not None:
            classes[Source.STEERING] = message_class(kind.steering_msgtype, needed_by)
        with reporting_start(lambda text: self._publish_status(Level.OK, text, [])):
            loaded = artefact.load(path, public_keys_path(self.values))
            settings = pipeline_settings(self.values, loaded.model.online)
            warm_up(loaded.model, settings)
        self._training = loaded.manifest["training"]
        self._trained = TrainingRange.from_json(self._training.get("range"))
        if loaded.model.lifting.warning:
            self._logger.warning(loaded.model.lifting.warning)

        frame_id = published_frame(self.values["frame_id"], settings.sensors.reference_point)
        self.core = Core(
            Pipeline(loaded.model, settings),
            self._publish,
            self._log_internal_error,
            frame_id=frame_id,
        )
        self._twist = TwistBytes(frame_id)
        self._horizon = self._covariance = self._stamped = None
        if settings.horizon_steps:
            self._horizon = HorizonBytes(frame_id, settings.horizon_steps)
            self._covariance = CovarianceBytes(settings.horizon_steps)
            self._stamped = StampedCovarianceBytes(frame_id, settings.horizon_steps, marked=True)
        self._publish_horizon = bool(self.values["publish_horizon"])
        self._sim_time = bool(self.node.get_parameter("use_sim_time").value)
        self.node.add_on_set_parameters_callback(self._on_set)
        self._create_outputs()
        self._debug = DebugTopics(self.node, frame_id, OUTPUT_DEPTH)
        self._plans: PlanTopics | None = None
        self._inputs = self._create_inputs(classes)
        self._rollouts = RolloutTopics(self.node, self.core, OUTPUT_DEPTH)
        if settings.horizon_steps:
            self._plans = PlanTopics(self.node, self.core, frame_id, OUTPUT_DEPTH, _input_qos())
        extrinsics = ImuExtrinsics(
            self.node, self.core, self._logger.info, self._warn_of_differences
        )
        # With transforms, the pose of the IMU is compared once it is known.
        self._pose_pending = extrinsics.subscription is not None
        self._warn_of_differences(settings.sensors, ignore_pose=self._pose_pending)
        self._facts = self._configuration(loaded)
        self.diagnostics = Diagnostics(
            self.core,
            self._facts,
            self.values["use_imu"],
            time.monotonic(),
            self._trained,
        )
        self._types = {Source.ODOMETRY: velocity.msgtype, Source.COMMAND: kind.msgtype}
        self._begin_s, self._waited = time.monotonic(), False
        self._logged_level = Level.OK
        self._logged_imu = False
        self._logger.info(", ".join(f"{key} {value}" for key, value in self._facts.items()))

    def _warn_of_differences(self, sensors: SensorConfig, *, ignore_pose: bool = False) -> None:
        """Say which sensor parameters differ from those that the model was trained with."""
        self._pose_pending = ignore_pose
        for text in differences_from_training(sensors, self._training):
            if not ignore_pose or "'imu_" not in text:
                self._logger.warning(text)

    def _create_outputs(self) -> None:
        node = self.node
        self._twist_out = OutputTopic(
            node, TwistWithCovarianceStamped, "~/predicted_twist", OUTPUT_DEPTH
        )
        self._horizon_out = OutputTopic(
            node, MultiDOFJointTrajectory, "~/predicted_horizon", OUTPUT_DEPTH
        )
        self._covariance_out = OutputTopic(
            node, Float64MultiArray, "~/predicted_horizon_covariance", OUTPUT_DEPTH
        )
        self._stamped_out = OutputTopic(
            node, JointTrajectory, "~/predicted_horizon_covariance_stamped", OUTPUT_DEPTH
        )
        node.create_service(Trigger, "~/reset", self._on_reset)
        node.create_service(SetBool, "~/enable", self._on_enable)
        # Both timers use steady time: simulation time may start late, stop, or never start.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(TICK_NS * 1e-9, self._on_timer, clock=steady)
        period_s = self.values["diagnostics_period_s"]
        node.create_timer(period_s, self._on_diagnostics, clock=steady)

    def _create_inputs(self, classes: dict[Source, Any]) -> dict[Source, Any]:
        kinds = {Source.IMU: Imu} | classes
        if self.values["use_imu"] == "never":
            del kinds[Source.IMU]
        return {
            source: self.node.create_subscription(
                kind, source.name.lower(), self._callback(source), _input_qos()
            )
            for source, kind in kinds.items()
        }

    def _callback(self, source: Source) -> Callable[[Any], None]:
        return self._on_odometry if source is _ODOMETRY else partial(self.core.on_message, source)

    def _on_odometry(self, msg: Any) -> None:
        if self._plans is not None:
            self._plans.odometry = msg
        self.core.on_message(_ODOMETRY, msg)

    def _configuration(self, loaded: artefact.Artefact) -> dict[str, str]:
        """Return the constant pairs of the diagnostics: model, method, topics."""
        facts = {
            "model": Path(loaded.path).name,
            "model_hash": str(loaded.manifest["sha256"][ARRAYS])[:12],
            "method": self.core.pipeline.predictor.settings.method,
        }
        for source in Source:
            topic = self._inputs[source].topic_name if source in self._inputs else "not used"
            facts[source.name.lower()] = topic
        return facts

    def _publish(self, prediction: Prediction) -> None:
        self._twist_out.send(self._twist.fill(prediction))
        if self._publish_horizon:
            self._publish_read_horizon(prediction)
            if self._plans is not None:
                self._plans.publish(prediction)
            self._rollouts.publish(prediction)
        predictor, tick_us = self.core.pipeline.predictor, self.core.counters.tick_us
        self._debug.publish(prediction, predictor, tick_us)

    def _publish_read_horizon(self, prediction: Prediction) -> None:
        """Publish what is subscribed to: filling all takes longer than the prediction itself."""
        covariance = prediction.horizon_covariance
        if self._horizon and self._horizon_out.is_read:
            self._horizon_out.send(self._horizon.fill(prediction.origin_ns, prediction.horizon))
        if self._covariance and self._covariance_out.is_read:
            self._covariance_out.send(self._covariance.fill(covariance))
        if self._stamped and self._stamped_out.is_read:
            distance = None
            sample = self.core.pipeline.last_sample
            if self._trained is not None and sample is not None:
                planned = self.core.pipeline.planned.commands
                commands = sample.u if planned is None else planned
                distance = self._trained.distance(prediction.horizon, commands)
            stamped = self._stamped.fill(prediction.origin_ns, covariance, distance)
            self._stamped_out.send(stamped)

    def _log_internal_error(self, error: Exception) -> None:
        self._logger.error(
            f"internal error, state was reset: {type(error).__name__}: {error} "
            "(logged once, counted in /diagnostics; traceback at log level debug)"
        )
        self._logger.debug("".join(traceback.format_exception(error)))

    def _on_timer(self) -> None:
        with self.core.guarded():
            self.core.on_timer(self._clock.now().nanoseconds)
            if self.diagnostics.is_overdue(time.monotonic()):
                self._report()

    def _on_reset(self, _request: Any, response: Any) -> Any:
        with self.core.guarded():
            self.core.reset()
        response.success = True
        response.message = "samples and adaptation are reset"
        return response

    def _on_enable(self, request: Any, response: Any) -> Any:
        with self.core.guarded():
            self.core.enable(request.data)
            self.diagnostics.begin(time.monotonic())
            self._report()
        response.success = True
        response.message = "enabled, starts afresh" if request.data else "disabled"
        return response

    def _on_set(self, changed: list[Any]) -> Any:
        for parameter in changed:
            if parameter.name == "publish_horizon":
                self._publish_horizon = bool(parameter.value)
            elif parameter.name == "use_sim_time":
                self._sim_time = bool(parameter.value)
        return SetParametersResult(successful=True)

    def _on_diagnostics(self) -> None:
        with self.core.guarded():
            self._report()
        # The automatic collector is off, see `freeze_garbage_collector`.
        gc.collect()

    def _report(self) -> None:
        now = self._clock.now()
        clocks = Clocks(time.monotonic(), now.nanoseconds, self._sim_time)
        level, text, values = self.diagnostics.report(clocks, self._publishers())
        self._publish_status(level, text, values)
        self._log(level, text)
        self._log_missing_topics()

    def _publishers(self) -> dict[Source, list[str]]:
        """Return the full names of the nodes that publish on the inputs."""
        return {
            source: [
                _full_name(info.node_namespace, info.node_name)
                for info in self.node.get_publishers_info_by_topic(subscription.topic_name)
            ]
            for source, subscription in self._inputs.items()
        }

    def _log_missing_topics(self) -> None:
        """Say once, after `_WAIT_S`, which topics nobody publishes and which exist instead."""
        if self._waited or time.monotonic() - self._begin_s < _WAIT_S:
            return
        self._waited = True
        if self._pose_pending:
            self._warn_of_differences(self.core.sensors)
        received = self.core.pipeline.received
        missing = {
            source: (str(self._inputs[source].topic_name), self._types[source])
            for source in (Source.ODOMETRY, Source.COMMAND)
            if not received[source]
        }
        if not missing:
            return
        topics = self.node.get_topic_names_and_types()
        published = [(name, types) for name, types in topics if self.node.count_publishers(name)]
        self._logger.warning(waiting_hint(missing, published))

    def _publish_status(self, level: Level, text: str, values: list[tuple[str, str]]) -> None:
        """Publish a status under the full name of the node, which tells two cars apart."""
        status = DiagnosticStatus(
            level=bytes([level]),
            name=self._name + DIAGNOSTIC_NAME,
            message=text,
            hardware_id=self._name,
            values=[KeyValue(key=key, value=value) for key, value in values],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._clock.now().to_msg()
        self._diagnostics_out.publish(array)

    def _log(self, level: Level, text: str) -> None:
        """Log a message when the level rises and when it returns to OK."""
        if not self._logged_imu and self.core.counters.published:
            self._logged_imu = True
            has_imu = self.core.pipeline.received[Source.IMU]
            self._logger.info("predicting with an IMU" if has_imu else "predicting without an IMU")
        started = self.core.counters.published or self._waited
        if level is Level.WARN and not self.core.counters.published:
            return
        if level is Level.ERROR and not started:
            # While the sensors start, the diagnostics say so, and the log after `_WAIT_S`.
            return
        # One call per severity: rclpy refuses another severity from the same line of code.
        if level > self._logged_level and level is Level.ERROR:
            self._logger.error(text)
        elif level > self._logged_level:
            self._logger.warning(text)
        elif level < self._logged_level and level is Level.OK:
            self._logger.info(text)
        self._logged_level = level


def _input_qos() -> Any:
    profile: Any = QoSProfile
    return profile(
        history=HistoryPolicy.KEEP_LAST,
        depth=INPUT_DEPTH,
        reliability=ReliabilityPolicy.BEST_EFFORT,
    )


def _full_name(namespace: str, name: str) -> str:
    """Return the full name of a node; the middleware finds its publishers a moment earlier."""
    if name == _UNKNOWN_NODE:
        return "a node not discovered yet"
    return f"{namespace.rstrip('/')}/{name}"


def freeze_garbage_collector() -> None:
    """
    Exclude all objects that exist now from garbage collection, and disable the collector.

    A full collection over torch and numba takes tens of milliseconds, more than a sample.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
