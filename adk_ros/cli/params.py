# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node's parameter file, read by the offline verbs: one description of the vehicle for all."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

import yaml

from adk_ros.cli import console
from adk_ros.errors import UsageError
from adk_ros.signals.decode import SensorConfig


def read_sensors(path: Path) -> SensorConfig:
    """
    Return the sensors described by a ROS parameter file (`NODE: ros__parameters: ...`).

    :raises UsageError: it is not readable, or a value does not fit.
    """
    try:
        from adk_ros.ros import parameters
    except ImportError as error:
        raise UsageError(
            f"--params needs rclpy, which is not installed ({error}): 'make install' brings it"
        ) from None
    values: dict[str, Any] = {spec.name: spec.default for spec in parameters.TABLE}
    specs = {spec.name: spec for spec in parameters.TABLE}
    for name, value in _parameters(path).items():
        if name not in specs:
            if name != "use_sim_time":
                close = difflib.get_close_matches(name, specs, 1)
                hint = f": did you mean '{close[0]}'?" if close else ""
                console.warn(f"{path}: parameter '{name}' is unknown and ignored{hint}")
            continue
        try:
            values[name] = specs[name].convert(value)
        except UsageError as error:
            raise UsageError(f"{path}: {error}") from None
    return parameters.sensor_config(values)


def _parameters(path: Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(path.read_text())
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except yaml.YAMLError as error:
        raise UsageError(f"{path} is not YAML: {str(error).splitlines()[0]}") from None
    found: dict[str, Any] = {}
    for block in content.values() if isinstance(content, dict) else ():
        if isinstance(block, dict) and isinstance(block.get("ros__parameters"), dict):
            found |= block["ros__parameters"]
    if not found:
        raise UsageError(f"{path} holds no 'ros__parameters': see config/predictor.yaml")
    return found
