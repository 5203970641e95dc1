# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the values of the node's parameters configure: sensors, adaptation, pipeline, files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.signals.channels import TICK_NS
from adk_ros.signals.corrections import CORRECTIONS
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.gate import GateSettings
from adk_ros.signals.velocity_messages import ODOMETRY

Values = Mapping[str, Any]


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
        use_tf=values["use_tf"],
        mass=values["mass"],
        wheel_radius=values["wheel_radius"],
        odometry_type=values["odometry_type"],
        wheel_joints=tuple(values["wheel_joints"]),
        sideslip=(values["sideslip"][0], values["sideslip"][1]),
        accelerometer_bias=(values["accelerometer_bias"][0], values["accelerometer_bias"][1]),
        **{name: values[name] for name in CORRECTIONS if name != "accelerometer_bias"},
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

    :raises UsageError: as `sensor_config` and `online_settings`; or no stream has a yaw rate.
    """
    sensors = sensor_config(values)
    if values["use_imu"] == "never" and sensors.odometry_type != ODOMETRY:
        raise UsageError(
            f"odometry_type '{sensors.odometry_type}' has no yaw rate, the IMU measures it: set "
            "use_imu to 'auto'"
        )
    return PipelineSettings(
        sensors=sensors,
        online=online_settings(values, model_settings),
        horizon_steps=round(values["horizon_s"] * 1e9 / TICK_NS),
        odometry_timeout_s=values["odometry_timeout_s"],
        frozen_after_s=values["frozen_after_s"],
        max_wait_s=values["max_wait_s"],
        max_coast_s=values["max_coast_s"],
        plan_timeout_s=values["plan_timeout_s"],
        gate=GateSettings(values["gate_false_rejection"], values["gate_confirmations"]),
    )


def model_path(values: Values) -> Path:
    """Return the model folder, with ~ expanded."""
    return Path(values["model"]).expanduser()


def public_keys_path(values: Values) -> Path | None:
    """Return the file of keys, with ~ expanded; None if none is given."""
    return Path(values["public_keys"]).expanduser() if values["public_keys"] else None
