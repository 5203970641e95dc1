# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Time integrals of the commands: the form in which the equations of motion read them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adk_ros.numerics.arrays import FloatArray

COMMAND_GRID_S = 0.0025
"""Spacing of the command integrals, s: a quarter of the shortest integration step."""


class CommandIntegrals(NamedTuple):
    """
    Integrals from the first command on, one value every `spacing` seconds.

    `torque` (g,) in N·m·s, `angle` (g,) of the road-wheel angle in rad·s. The mean of a held
    command over any interval is a difference of two values.
    """

    torque: FloatArray
    angle: FloatArray
    spacing: float


def cumulative_command(
    at_s: FloatArray, values: FloatArray, spacing: float, end_s: float
) -> FloatArray:
    """Return the integral of a zero-order-held signal from its first stamp to `end_s`."""
    grid = np.arange(0.0, end_s - at_s[0] + 2.0 * spacing, spacing)
    knots = np.concatenate([at_s - at_s[0], [grid[-1] + spacing]])
    total = np.concatenate([[0.0], np.cumsum(values * np.diff(knots))])
    return np.asarray(np.interp(grid, knots, total))


def integrate_commands(at_s: FloatArray, command: FloatArray, end_s: float) -> CommandIntegrals:
    """Return the integrals of commands (c, 2), torque and road-wheel angle, given at `at_s`."""
    return CommandIntegrals(
        cumulative_command(at_s, command[:, 0], COMMAND_GRID_S, end_s),
        cumulative_command(at_s, command[:, 1], COMMAND_GRID_S, end_s),
        COMMAND_GRID_S,
    )
