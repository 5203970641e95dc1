# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A ROS parameter file, read and written without ROS.

Keys given twice are allowed, as in ROS: the last one counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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

    Also returns one warning per unknown parameter, and one for blocks that are left out. The block
    is that of the node `predictor`, or else of one whose name ends in that, or the only one in the
    file; one of a wildcard (`/**`) counts for all nodes. Later blocks override earlier ones.
    :raises UsageError: it is not readable, holds no parameters or those of several such nodes, or
        a value does not fit.
    """
    values = defaults()
    specs = {spec.name: spec for spec in TABLE}
    content, warnings = _file_content(path)
    for name, value in content.items():
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


def _file_content(path: Path) -> tuple[dict[str, Any], list[str]]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        # ValueError: no UTF-8, or a date or number that does not exist.
        raise UsageError(f"{path} is not YAML: {first_line(error)}") from None
    try:
        blocks = list(_blocks(content))
    except RecursionError:
        raise UsageError(f"{path} is nested too deeply, or refers to itself") from None
    nodes = list(dict.fromkeys(name for name, _ in blocks if not name.endswith("*")))
    named = [name for name in nodes if name.rpartition("/")[2] == "predictor"]
    named = named or [name for name in nodes if name.endswith("predictor")]
    if not named and all(name in nodes for name, _ in blocks):
        named = nodes
    if len(named) > 1:
        raise UsageError(
            f"{path} holds parameters of several nodes ({', '.join(named)}): give a file with "
            "those of one predictor"
        )
    found: dict[str, Any] = {}
    for name, block in blocks:
        if name in named or name.endswith("*"):
            found |= {str(key): value for key, value in block.items()}
    if not found:
        raise UsageError(f"{path} holds no 'ros__parameters': see config/predictor.yaml")
    left_out = [name for name in nodes if name not in named]
    warnings = []
    if left_out:
        names = ", ".join(left_out)
        warnings.append(one_line(f"{path}: parameters of other nodes are not used ({names})"))
    return found, warnings


def _blocks(content: Any, node: str = "") -> Iterator[tuple[str, dict[Any, Any]]]:
    """Yield the name of each node, with its namespaces, and its parameters."""
    if not isinstance(content, dict):
        return
    for key, value in content.items():
        if key == "ros__parameters" and isinstance(value, dict):
            yield node.removeprefix("/"), value
        elif key != "ros__parameters":
            yield from _blocks(value, f"{node}/{key}" if node else str(key))
