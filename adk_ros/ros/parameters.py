# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The node's parameters: one table, from which declarations, checks and the sample YAML follow.

ROS parameters are strictly typed, and a whole number given to a real one is refused with an
exception. Here each is first declared without a type, read, converted and checked, and then
declared as what it is; so `20` serves for `20.0`, and a mistake costs one line of text.
"""

from __future__ import annotations

import difflib
import math
import textwrap
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import METHODS, OnlineSettings
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.signals.channels import TICK_NS
from adk_ros.signals.commands import COMMAND_TYPES
from adk_ros.signals.decode import SensorConfig

Value = str | bool | int | float | list[float] | list[str]
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Spec:
    """
    One parameter; the type of `default` is its type, in a list that of the elements.

    `low` and `high` bound a number and each number of a list, `length` is that of a list of
    numbers. `live`: may be changed while the node runs; the others make up the pipeline.
    """

    name: str
    default: Value
    text: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    live: bool = False

    @property
    def wanted(self) -> str:
        """What a value must be, in words."""
        if self.choices:
            return "one of " + ", ".join(repr(choice) for choice in self.choices)
        if isinstance(self.default, list):
            if isinstance(self.default[0], str):
                return "a list of one name or more"
            return f"a list of {len(self.default)} numbers{self._range}"
        words = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
        return words[type(self.default)] + self._range

    @property
    def _range(self) -> str:
        return f" from {self.low:g} to {self.high:g}" if math.isfinite(self.high) else ""

    def convert(self, value: Any) -> Value:
        """
        Return `value` in the parameter's own type.

        :raises UsageError: it does not fit; the text names the parameter, and what was given.
        """
        converted = self._converted(value)
        if converted is None:
            given = "nothing" if value is None else repr(_plain(value))
            raise UsageError(f"parameter '{self.name}' is {given}: give {self.wanted}")
        return converted

    def _converted(self, value: Any) -> Value | None:
        default = self.default
        if isinstance(default, bool):
            return value if isinstance(value, bool) else None
        if isinstance(default, str):
            fits = isinstance(value, str) and (not self.choices or value in self.choices)
            return value if fits else None
        if isinstance(default, list):
            items = [value] if isinstance(value, str) else _plain(value)
            if not isinstance(items, list):
                return None
            if isinstance(default[0], str):
                names = [item for item in items if isinstance(item, str) and item]
                return names if names and len(names) == len(items) else None
            numbers = [self._number(item) for item in items]
            whole = [number for number in numbers if number is not None]
            return whole if len(whole) == len(items) == len(default) else None
        number = self._number(value)
        if number is None or isinstance(default, float):
            return number
        return int(number) if number == int(number) else None

    def _number(self, value: Any) -> float | None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        fits = math.isfinite(value) and self.low <= value <= self.high
        return float(value) if fits else None

    def descriptor(self) -> ParameterDescriptor:
        """The parameter as `ros2 param describe` shows it."""
        described = ParameterDescriptor(name=self.name, description=self.text)
        described.read_only = not self.live
        if self.choices:
            described.additional_constraints = self.wanted
        if math.isfinite(self.high):
            if isinstance(self.default, int):
                bounds = IntegerRange(from_value=int(self.low), to_value=int(self.high))
                described.integer_range = [bounds]
            elif isinstance(self.default, float):
                limits = FloatingPointRange(from_value=self.low, to_value=self.high)
                described.floating_point_range = [limits]
        return described


def _plain(value: Any) -> Any:
    """ROS gives arrays as array.array: a list is what a person gave."""
    return list(value) if hasattr(value, "__iter__") and not isinstance(value, str) else value


TABLE: tuple[Spec, ...] = (
    Spec("model", "", "Folder that 'adk train' wrote; required."),
    Spec(
        "method",
        "",
        "Online method; empty: the one that the model was validated with.",
        choices=("", *METHODS),
    ),
    Spec("window", 0, "Samples in the least-squares window; 0: the model's own.", 0, 100_000),
    Spec(
        "ridge",
        0.0,
        "Pull to the offline model, in samples' worth; 0: the model's own.",
        0.0,
        1e12,
    ),
    Spec("forgetting", 0.0, "Factor per tick of method ffrls; 0: the model's own.", 0.0, 1.0),
    Spec("horizon_s", 2.0, "Length of the predicted horizon in s; 0: none.", 0.0, 10.0),
    Spec("publish_horizon", True, "Publish ~/predicted_horizon and its covariance.", live=True),
    Spec("frame_id", "base_link", "Frame in whose axes the predicted twist is given."),
    Spec(
        "use_imu",
        "auto",
        "auto: use an IMU where there is one; required: report an error "
        "without one; never: do not subscribe.",
        choices=("auto", "required", "never"),
    ),
    Spec(
        "reference_point",
        [0.0, 0.0],
        "Centre of gravity (x, y) in the odometry's child frame, "
        "m; velocities are predicted there.",
        -50.0,
        50.0,
    ),
    Spec("imu_position", [0.0, 0.0], "IMU (x, y) in the odometry's child frame, m.", -50.0, 50.0),
    Spec(
        "imu_rotation",
        [0.0, 0.0, 0.0],
        "Roll, pitch, yaw that turn the IMU's axes into the vehicle's, rad.",
        -2 * math.pi,
        2 * math.pi,
    ),
    Spec("command_type", "joint_state", "Kind of command message.", choices=tuple(COMMAND_TYPES)),
    Spec("drive_joints", ["drive"], "Joints whose efforts add up to the net wheel torque, N m."),
    Spec("steer_joint", "steer", "Joint whose position is the steering angle, rad."),
    Spec(
        "steering_ratio",
        1.0,
        "Steer joint's angle over road-wheel angle; 1: it is the road "
        "wheel's; negative: it turns the other way.",
        -1000.0,
        1000.0,
    ),
    Spec(
        "mass",
        0.0,
        "Vehicle mass in kg; needed where a command carries an acceleration.",
        0.0,
        1e6,
    ),
    Spec(
        "wheel_radius",
        0.0,
        "Wheel radius in m; needed where a command carries an acceleration.",
        0.0,
        10.0,
    ),
    Spec("odometry_timeout_s", 0.5, "Odometry older than this gives no state.", 0.0, 60.0),
    Spec(
        "frozen_after_s",
        1.0,
        "A moving vehicle's sensor that repeats itself for so long is frozen; 0: never.",
        0.0,
        3600.0,
    ),
    Spec("max_wait_s", 0.05, "How long a tick waits for a reading that is due.", 0.0, 0.5),
    Spec(
        "max_coast_s",
        1.0,
        "How long predictions go on from themselves without a state.",
        0.0,
        60.0,
    ),
    Spec("diagnostics_period_s", 1.0, "Time between two diagnostics, wall clock.", 0.1, 60.0),
)


def read(node: Any) -> dict[str, Any]:
    """
    Declare the table on `node` and return the values, by name.

    :raises UsageError: a value does not fit, or `model` is not given.
    """
    values: dict[str, Any] = {}
    for spec in TABLE:
        loose = ParameterDescriptor(dynamic_typing=True)
        given = node.declare_parameter(spec.name, spec.default, loose).value
        values[spec.name] = spec.convert(given)
        node.undeclare_parameter(spec.name)
        node.declare_parameter(
            spec.name, values[spec.name], spec.descriptor(), ignore_override=True
        )
    if not values["model"]:
        raise UsageError(
            "parameter 'model' is not given: give the folder that 'adk train' wrote, "
            "--ros-args -p model:=FOLDER"
        )
    return values


def unknown(node: Any) -> list[str]:
    """What was given for parameters that do not exist, one line each with the likely name."""
    names = [spec.name for spec in TABLE]
    own = ("use_sim_time", "start_type_description_service", "qos_overrides.")
    lines = []
    for name in getattr(node, "_parameter_overrides", {}):
        if name in names or name.startswith(own):
            continue
        close = difflib.get_close_matches(name, names, 1)
        hint = f": did you mean '{close[0]}'?" if close else ""
        lines.append(f"parameter '{name}' is unknown and ignored{hint}")
    return lines


def sensor_config(values: Values) -> SensorConfig:
    """:raises UsageError: the values contradict each other."""
    return SensorConfig(
        command_type=values["command_type"],
        drive_joints=tuple(values["drive_joints"]),
        steer_joint=values["steer_joint"],
        steering_ratio=values["steering_ratio"],
        reference_point=(values["reference_point"][0], values["reference_point"][1]),
        imu_position=(values["imu_position"][0], values["imu_position"][1]),
        imu_rotation=tuple(values["imu_rotation"]),
        mass=values["mass"],
        wheel_radius=values["wheel_radius"],
    )


def unlike_training(sensors: SensorConfig, training: Mapping[str, Any]) -> list[str]:
    """Where the vehicle is described otherwise than when the model was trained, a line each."""
    trained = training.get("sensors") or {}
    lines = []
    for name, value in asdict(sensors).items():
        given = list(value) if isinstance(value, tuple) else value
        if name in trained and trained[name] != given:
            lines.append(
                f"parameter '{name}' is {given}, but the model was trained with {trained[name]}"
            )
    return lines


def online_settings(values: Values, own: OnlineSettings) -> OnlineSettings:
    """
    The model's `own` settings, with those replaced that were given.

    :raises UsageError: a value is out of the method's range.
    """
    names = ("method", "window", "ridge", "forgetting")
    return replace(own, **{name: values[name] for name in names if values[name]})


def pipeline_settings(values: Values, own: OnlineSettings) -> PipelineSettings:
    """:raises UsageError: as `sensor_config` and `online_settings`."""
    return PipelineSettings(
        sensors=sensor_config(values),
        online=online_settings(values, own),
        horizon_steps=round(values["horizon_s"] * 1e9 / TICK_NS),
        odometry_timeout_s=values["odometry_timeout_s"],
        frozen_after_s=values["frozen_after_s"],
        max_wait_s=values["max_wait_s"],
        max_coast_s=values["max_coast_s"],
    )


def model_path(values: Values) -> Path:
    """Folder of the model, with ~ for the home folder."""
    return Path(values["model"]).expanduser()


def help_text() -> str:
    """Return the table for a person at a terminal."""
    width = max(len(spec.name) for spec in TABLE)
    lines = []
    for spec in TABLE:
        lines += textwrap.wrap(
            f"{spec.text} [{spec.default!r}]",
            98,
            initial_indent=f"  {spec.name:<{width}}  ",
            subsequent_indent=" " * (width + 4),
        )
    return "\n".join(lines)
