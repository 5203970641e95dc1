# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the commands that a planner asks predictions for."""

from __future__ import annotations

from typing import Any

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.numerics.arrays import FloatArray


def checked_commands(commands: Any, shape: str) -> FloatArray:
    """
    Return `commands` as a contiguous float64 array, N·m and rad.

    :param shape: the shape wanted, such as "(h, 2)", whose letters stand for any size.
    :raises UsageError: the shape is another, or a value is not finite.
    """
    try:
        values = np.asarray(commands, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise UsageError(f"commands are not an array of numbers of shape {shape}") from None
    if values.ndim != shape.count(",") + 1 or values.shape[-1] != 2:
        raise UsageError(
            f"commands have shape {values.shape}: give {shape}, the last axis wheel torque in N·m "
            "and road-wheel angle in rad"
        )
    finite = np.isfinite(values)
    if not finite.all():
        first = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise UsageError(
            f"command {first} is {values[first]}: give finite wheel torques in N·m and "
            "road-wheel angles in rad"
        )
    return values


def unpredictable(commands: FloatArray, name: str) -> UsageError:
    """Return the error that finite `commands` (h, 2) of `name` lead to states that are not."""
    torque, delta = np.abs(commands).max(axis=0)
    return UsageError(
        f"{name} leads to states that are not finite: its wheel torques reach {torque:.3g} N·m "
        f"and its road-wheel angles {delta:.3g} rad; give commands as in the model's training data"
    )
