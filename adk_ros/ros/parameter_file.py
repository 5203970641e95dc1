# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A ROS parameter file, read and written without ROS.

Keys given twice are allowed, as in ROS: the last one counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped, unused-ignore]

from adk_ros.errors import UsageError, first_line, one_line
from adk_ros.ros.parameter_table import TABLE, defaults, unknown_parameter
from adk_ros.signals.decode import SensorConfig


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


def write_sensor_parameters(path: Path, sensors: SensorConfig) -> None:
    """Write a ROS parameter file with the sensor configuration, for `--params`."""
    names = {spec.name for spec in TABLE}
    values = {name: value for name, value in asdict(sensors).items() if name in names}
    write_parameters(path, values)


def write_parameters(path: Path, values: Mapping[str, Any]) -> None:
    """Write a ROS parameter file with the given values by name, for `--params` and the node."""
    plain = {name: list(v) if isinstance(v, tuple) else v for name, v in values.items()}
    content = {"/**": {"ros__parameters": plain}}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def _file_content(path: Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        # ValueError: no UTF-8, or a date or number that does not exist.
        raise UsageError(f"{path} is not YAML: {first_line(error)}") from None
    found: dict[str, Any] = {}
    for block in content.values() if isinstance(content, dict) else ():
        if isinstance(block, dict) and isinstance(block.get("ros__parameters"), dict):
            found |= {str(name): value for name, value in block["ros__parameters"].items()}
    if not found:
        raise UsageError(f"{path} holds no 'ros__parameters': see config/predictor.yaml")
    return found
