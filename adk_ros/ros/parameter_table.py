# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The node's parameters: names, defaults, ranges, descriptions, conversion, parameter files.

Nothing here imports rclpy or a ROS message, so the offline verbs read a parameter file on a
machine without ROS. `ros.parameters` declares this table on the node.
"""

from __future__ import annotations

import difflib
import math
import textwrap
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped, unused-ignore]

from adk_ros.errors import UsageError, one_line
from adk_ros.model.adaptation.online_methods import METHODS, OnlineSettings
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.signals.channels import TICK_NS
from adk_ros.signals.commands import COMMAND_TYPES
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.gate import GateSettings

Value = str | bool | int | float | list[float] | list[str]
Values = Mapping[str, Any]

_ROS_PARAMETERS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""Names, or beginnings of names, of parameters that rclpy itself declares."""

_HELP_WIDTH = 98
"""Characters per line of `help_text`."""


@dataclass(frozen=True)
class ParameterSpec:
    """
    One parameter. The type of `default` is the parameter's type; for a list, of its elements.

    `low` and `high` bound a number and each number of a list; `default` gives the length of a
    list of numbers. `live`: can be changed while the node runs; all others are fixed at start-up.
    """

    name: str
    default: Value
    text: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    live: bool = False

    @property
    def expected(self) -> str:
        """Description of the accepted values, for messages."""
        if self.choices:
            return "one of " + ", ".join(repr(choice) for choice in self.choices)
        if isinstance(self.default, list):
            if isinstance(self.default[0], str):
                return "a list of at least one name"
            return f"a list of {len(self.default)} numbers{self._range}"
        words = {bool: "true or false", int: "a whole number", float: "a number", str: "a string"}
        return words[type(self.default)] + self._range

    @property
    def _range(self) -> str:
        return f" from {self.low:g} to {self.high:g}" if math.isfinite(self.high) else ""

    def convert(self, value: Any) -> Value:
        """
        Return `value` in the type of the parameter; whole numbers are accepted for real ones.

        :raises UsageError: it does not fit; the message names the parameter and the value.
        """
        converted = self._converted(value)
        if converted is None:
            given = "empty" if value is None else repr(as_list(value))
            raise UsageError(f"parameter '{self.name}' is {given}: give {self.expected}")
        return converted

    def _converted(self, value: Any) -> Value | None:
        default = self.default
        if isinstance(default, bool):
            return value if isinstance(value, bool) else None
        if isinstance(default, str):
            fits = isinstance(value, str) and (not self.choices or value in self.choices)
            return value if fits else None
        if isinstance(default, list):
            items = [value] if isinstance(value, str) else as_list(value)
            if not isinstance(items, list):
                return None
            if isinstance(default[0], str):
                names = [item for item in items if isinstance(item, str) and item]
                return names if names and len(names) == len(items) else None
            numbers = [self._number(item) for item in items]
            valid = [number for number in numbers if number is not None]
            return valid if len(valid) == len(items) == len(default) else None
        number = self._number(value)
        if number is None or isinstance(default, float):
            return number
        return int(number) if number == int(number) else None

    def _number(self, value: Any) -> float | None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        fits = math.isfinite(value) and self.low <= value <= self.high
        return float(value) if fits else None


def as_list(value: Any) -> Any:
    """Return an array as a list (ROS delivers array.array); any other value unchanged."""
    return list(value) if hasattr(value, "__iter__") and not isinstance(value, str) else value


TABLE: tuple[ParameterSpec, ...] = (
    ParameterSpec("model", "", "Model folder written by 'adk train'; required."),
    ParameterSpec(
        "public_keys",
        "",
        "File with the SSH keys (Ed25519) of which one must have signed the model; empty: nobody "
        "must.",
    ),
    ParameterSpec(
        "method",
        "",
        "Online adaptation method; empty: the method that the model was validated with.",
        choices=("", *METHODS),
    ),
    ParameterSpec(
        "window",
        0,
        "Samples in the least-squares window; 0: the value stored with the model.",
        0,
        100_000,
    ),
    ParameterSpec(
        "ridge",
        0.0,
        "Weight of the offline model, in equivalent samples; 0: the value stored with the model.",
        0.0,
        1e12,
    ),
    ParameterSpec(
        "forgetting",
        0.0,
        "Forgetting factor per sample of method ffrls; 0: the value stored with the model.",
        0.0,
        1.0,
    ),
    ParameterSpec(
        "horizon_s", 2.0, "Length of the predicted horizon, s; 0: no horizon.", 0.0, 10.0
    ),
    ParameterSpec(
        "publish_horizon", True, "Publish ~/predicted_horizon and its covariance.", live=True
    ),
    ParameterSpec(
        "frame_id",
        "",
        "Frame of the predicted twist, with its origin at reference_point; empty: base_link, or "
        "centre_of_gravity if reference_point is not zero.",
    ),
    ParameterSpec(
        "use_imu",
        "auto",
        "auto: use an IMU if one publishes; required: report an error without one; "
        "never: do not subscribe.",
        choices=("auto", "required", "never"),
    ),
    ParameterSpec(
        "reference_point",
        [0.0, 0.0],
        "Centre of gravity (x, y) in the odometry's child frame, m; velocities are predicted at "
        "this point.",
        -50.0,
        50.0,
    ),
    ParameterSpec(
        "imu_position",
        [0.0, 0.0],
        "IMU position (x, y) in the odometry's child frame, m.",
        -50.0,
        50.0,
    ),
    ParameterSpec(
        "imu_rotation",
        [0.0, 0.0, 0.0],
        "Roll, pitch, yaw of the rotation from IMU axes to vehicle axes, rad.",
        -2 * math.pi,
        2 * math.pi,
    ),
    ParameterSpec(
        "command_type", "joint_state", "Type of command message.", choices=tuple(COMMAND_TYPES)
    ),
    ParameterSpec(
        "drive_joints",
        ["drive"],
        "Joints whose efforts add up to the net wheel torque, N·m.",
    ),
    ParameterSpec("steer_joint", "steer", "Joint whose position is the steering angle, rad."),
    ParameterSpec(
        "steering_ratio",
        1.0,
        "Steer joint angle divided by road-wheel angle; 1: the joint is the road wheel; "
        "negative: opposite sense of rotation.",
        -1000.0,
        1000.0,
    ),
    ParameterSpec(
        "mass",
        0.0,
        "Vehicle mass, kg; required if the command is an acceleration.",
        0.0,
        1e6,
    ),
    ParameterSpec(
        "wheel_radius",
        0.0,
        "Wheel radius, m; required if the command is an acceleration.",
        0.0,
        10.0,
    ),
    ParameterSpec(
        "odometry_timeout_s",
        0.5,
        "Age beyond which odometry no longer gives a state, s.",
        0.0,
        60.0,
    ),
    ParameterSpec(
        "frozen_after_s",
        1.0,
        "Declare a sensor frozen after it repeats the same value for this long while the vehicle "
        "moves, s; 0: off.",
        0.0,
        3600.0,
    ),
    ParameterSpec("max_wait_s", 0.05, "Longest wait for a reading that is due, s.", 0.0, 0.5),
    ParameterSpec(
        "max_coast_s",
        1.0,
        "How long to keep predicting without odometry, s.",
        0.0,
        60.0,
    ),
    ParameterSpec(
        "gate_false_rejection",
        1e-6,
        "Share of good IMU and odometry readings that may be rejected as contradicting the "
        "prediction; 0: reject none.",
        0.0,
        0.1,
    ),
    ParameterSpec(
        "gate_confirmations",
        5,
        "Rejected readings in succession after which a new level is accepted.",
        2,
        1000,
    ),
    ParameterSpec(
        "diagnostics_period_s", 1.0, "Period of /diagnostics in wall-clock time, s.", 0.1, 60.0
    ),
)


def defaults() -> dict[str, Any]:
    """Return the default values, by parameter name."""
    return {spec.name: spec.default for spec in TABLE}


def unknown_parameter(name: str) -> str | None:
    """Return a warning if the table and rclpy lack this parameter, with the closest known name."""
    names = [spec.name for spec in TABLE]
    if name in names or name.startswith(_ROS_PARAMETERS):
        return None
    close = difflib.get_close_matches(name, names, 1)
    hint = f": did you mean '{close[0]}'?" if close else ""
    return f"parameter '{name}' is unknown and ignored{hint}"


def read_parameter_file(path: Path) -> tuple[dict[str, Any], list[str]]:
    """
    Return the values in a ROS parameter file (`NODE: ros__parameters: ...`), defaults elsewhere.

    Also returns one warning per unknown parameter. Later blocks of the file override earlier ones.
    :raises UsageError: it is not readable, holds no parameters, or a value does not fit.
    """
    values = defaults()
    specs = {spec.name: spec for spec in TABLE}
    warnings = []
    for name, value in _file_content(path).items():
        if name in specs:
            try:
                values[name] = specs[name].convert(value)
            except UsageError as error:
                raise UsageError(f"{path}: {error}") from None
        elif (warning := unknown_parameter(name)) is not None:
            warnings.append(one_line(f"{path}: {warning}"))
    return values, warnings


def _file_content(path: Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        # ValueError: no UTF-8, or a date or number that does not exist.
        raise UsageError(f"{path} is not YAML: {str(error).splitlines()[0]}") from None
    found: dict[str, Any] = {}
    for block in content.values() if isinstance(content, dict) else ():
        if isinstance(block, dict) and isinstance(block.get("ros__parameters"), dict):
            found |= {str(name): value for name, value in block["ros__parameters"].items()}
    if not found:
        raise UsageError(f"{path} holds no 'ros__parameters': see config/predictor.yaml")
    return found


def sensor_config(values: Values) -> SensorConfig:
    """
    Return the sensor configuration that the values describe.

    :raises UsageError: the values contradict each other.
    """
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


def differences_from_training(sensors: SensorConfig, training: Mapping[str, Any]) -> list[str]:
    """Return one line per sensor parameter whose value differs from the one used in training."""
    trained = training.get("sensors") or {}
    lines = []
    for name, value in asdict(sensors).items():
        given = list(value) if isinstance(value, tuple) else value
        if name in trained and trained[name] != given:
            lines.append(
                f"parameter '{name}' is {given}, but the model was trained with {trained[name]}"
            )
    return lines


def online_settings(values: Values, model_settings: OnlineSettings) -> OnlineSettings:
    """
    Return the model's settings with those replaced that the values give (not empty, not zero).

    :raises UsageError: a value is out of the method's range.
    """
    names = ("method", "window", "ridge", "forgetting")
    return replace(model_settings, **{name: values[name] for name in names if values[name]})


def pipeline_settings(values: Values, model_settings: OnlineSettings) -> PipelineSettings:
    """
    Return the pipeline's settings.

    :raises UsageError: as `sensor_config` and `online_settings`.
    """
    return PipelineSettings(
        sensors=sensor_config(values),
        online=online_settings(values, model_settings),
        horizon_steps=round(values["horizon_s"] * 1e9 / TICK_NS),
        odometry_timeout_s=values["odometry_timeout_s"],
        frozen_after_s=values["frozen_after_s"],
        max_wait_s=values["max_wait_s"],
        max_coast_s=values["max_coast_s"],
        gate=GateSettings(values["gate_false_rejection"], values["gate_confirmations"]),
    )


def model_path(values: Values) -> Path:
    """Return the model folder, with ~ expanded."""
    return Path(values["model"]).expanduser()


def public_keys_path(values: Values) -> Path | None:
    """Return the file of keys, with ~ expanded; None if none is given."""
    return Path(values["public_keys"]).expanduser() if values["public_keys"] else None


def help_text() -> str:
    """Return the table for a terminal."""
    width = max(len(spec.name) for spec in TABLE)
    lines = []
    for spec in TABLE:
        lines += textwrap.wrap(
            f"{spec.text} [{spec.default!r}]",
            _HELP_WIDTH,
            initial_indent=f"  {spec.name:<{width}}  ",
            subsequent_indent=" " * (width + 4),
        )
    return "\n".join(lines)
