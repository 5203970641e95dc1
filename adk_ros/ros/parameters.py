# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Declare the parameter table on a node and read the values.

ROS parameters are strictly typed: rclpy raises an exception for a whole number given to a real
parameter. Each parameter is therefore first declared without a type, read, converted and checked,
and then declared with its type. So `20` is accepted for `20.0`, and a wrong value gives a
one-line message.
"""

from __future__ import annotations

import math
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from adk_ros.errors import UsageError
from adk_ros.ros.parameter_spec import ParameterSpec
from adk_ros.ros.parameter_table import TABLE, unknown_parameter

__all__ = ["TABLE", "declare_parameters", "descriptor", "unknown_parameters"]


def descriptor(spec: ParameterSpec) -> ParameterDescriptor:
    """Return the descriptor of a parameter, as `ros2 param describe` shows it."""
    described = ParameterDescriptor(name=spec.name, description=spec.text)
    described.read_only = not spec.live
    if spec.choices:
        described.additional_constraints = spec.expected
    if math.isfinite(spec.high):
        if isinstance(spec.default, int):
            bounds = IntegerRange(from_value=int(spec.low), to_value=int(spec.high))
            described.integer_range = [bounds]
        elif isinstance(spec.default, float):
            limits = FloatingPointRange(from_value=spec.low, to_value=spec.high)
            described.floating_point_range = [limits]
    return described


def declare_parameters(node: Any) -> dict[str, Any]:
    """
    Declare the table on `node` and return the values, by name.

    :raises UsageError: a value does not fit, or `model` is not given.
    """
    values: dict[str, Any] = {}
    for spec in TABLE:
        untyped = ParameterDescriptor(dynamic_typing=True)
        given = node.declare_parameter(spec.name, spec.default, untyped).value
        values[spec.name] = spec.convert(given)
        node.undeclare_parameter(spec.name)
        node.declare_parameter(
            spec.name, values[spec.name], descriptor(spec), ignore_override=True
        )
    if not values["model"]:
        raise UsageError(
            "parameter 'model' is not given: give a model folder written by 'adk train', "
            "--ros-args -p model:=FOLDER"
        )
    return values


def unknown_parameters(node: Any) -> list[str]:
    """Return one warning per given parameter that is not in the table, with the closest name."""
    warnings = map(unknown_parameter, getattr(node, "_parameter_overrides", {}))
    return [warning for warning in warnings if warning is not None]
