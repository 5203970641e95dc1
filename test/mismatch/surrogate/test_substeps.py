# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of a scale model are those of the similar full-size car."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.surrogate.command_integrals import integrate_commands
from adk_ros.mismatch.surrogate.run_inputs import no_terms, open_loop_inputs, run_buffers
from adk_ros.mismatch.surrogate.state_index import A_Y, S_V_X, STATE_SIZE, V_X, YAW_RATE
from adk_ros.mismatch.surrogate.substeps import integrate_in_substeps, scale_of
from adk_ros.numerics.arrays import FloatArray


def steered(size: float, mass: float) -> FloatArray:
    """Return the output of a car of 2.7 m times `size` that steers at 12 m/s in full size."""
    full = size == 1.0
    vehicle = NominalVehicle(
        mass=mass, yaw_inertia=mass * 1.3 * 1.4 * size**2, cg_to_front_axle=1.3 * size,
        cg_to_rear_axle=1.4 * size, track_width=1.6 * size, cg_height=0.53 * size,
        wheel_radius=0.325 * size, wheel_inertia=mass / 1500.0 * 1.3 * size**2,
        side_force_area=0.0, yaw_moment_volume=0.0,
    )  # fmt: skip
    p = vehicle.parameters()
    assert (scale_of(p) == 1.0) == full
    tempo = np.sqrt(size)
    step, n = 0.01 * tempo, 400
    at_s = np.arange(0.0, 5.0 * tempo, 0.025 * tempo)
    command = np.column_stack([0.0 * at_s, 0.03 * np.sin(4.0 * at_s / tempo)])
    state = np.zeros(STATE_SIZE)
    state[S_V_X] = 12.0 * tempo
    buffers = run_buffers(state, n)
    commands = integrate_commands(at_s, command, 6.0 * tempo)
    integrate_in_substeps(p, no_terms(n), open_loop_inputs(commands, 0.0, step, n), buffers)
    return buffers.output


def test_a_tenth_of_a_car_turns_alike() -> None:
    size = 0.1
    tempo = np.sqrt(size)
    full, small = steered(1.0, 1500.0), steered(size, 1.5)
    assert np.abs(full[A_Y]).max() > 1.0
    assert small[A_Y] == pytest.approx(full[A_Y], abs=0.05 * np.abs(full[A_Y]).max())
    turning = full[YAW_RATE] / tempo
    assert small[YAW_RATE] == pytest.approx(turning, abs=0.05 * np.abs(turning).max())
    assert small[V_X] == pytest.approx(tempo * full[V_X], rel=0.01)
