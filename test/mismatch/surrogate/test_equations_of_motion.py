# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The surrogate's equations of motion, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.mismatch import CAR, car, steady, with_commands

from adk_ros.mismatch.library.surrogate_parameters import (
    HIGH,
    LOW,
    SURROGATE_PARAMETERS,
    default_parameters,
)
from adk_ros.mismatch.surrogate.command_integrals import COMMAND_GRID_S, CommandIntegrals
from adk_ros.mismatch.surrogate.command_response import zoh_mean
from adk_ros.mismatch.surrogate.equations_of_motion import integrate
from adk_ros.mismatch.surrogate.residuals import STEP_S, ResidualProblem, prepare_residual_problem
from adk_ros.mismatch.surrogate.run_inputs import no_terms, open_loop_inputs, run_buffers
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    S_V_X,
    S_V_Y,
    STATE_SIZE,
    V_X,
    V_Y,
    YAW_RATE,
)
from adk_ros.mismatch.surrogate.step_constants import (
    first_order_lag,
    lag_of,
    resonance_of,
    second_order_lag,
)
from adk_ros.mismatch.surrogate.wheel_forces import normalised_lateral_force
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY


def run(problem: ResidualProblem, p: FloatArray) -> FloatArray:
    """Run without an observer, v_x prescribed."""
    return problem.run(p, gain=0.0)


def test_default_parameters_lie_within_their_bounds() -> None:
    assert np.all((default_parameters() >= LOW) & (default_parameters() <= HIGH))
    assert all(entry.unit and entry.description for entry in SURROGATE_PARAMETERS.values())


def test_a_steady_circle_has_the_understeer_gradient() -> None:
    delta, speed = 0.01, 20.0
    p = car(cg_height=0.0, stiffness_f=16.0, stiffness_r=20.0)
    out = run(prepare_residual_problem(steady(speed, delta)), p)
    front = GRAVITY * CAR.cg_to_rear_axle / (CAR.cg_to_front_axle + CAR.cg_to_rear_axle)
    rear = GRAVITY - front
    # Axle loads over their stiffnesses: m_f / C_f - m_r / C_r.
    gradient = front / (16.0 * front) - rear / (20.0 * rear)
    wheelbase = CAR.cg_to_front_axle + CAR.cg_to_rear_axle
    expected = speed * delta / (wheelbase + gradient * speed**2 / GRAVITY)
    assert out[YAW_RATE, -1] == pytest.approx(expected, rel=5e-3)
    assert out[A_Y, -1] == pytest.approx(speed * out[YAW_RATE, -1], rel=1e-6)


def test_left_and_right_turns_are_mirror_images() -> None:
    left = run(prepare_residual_problem(steady(20.0, 0.02, 500.0)), car())
    right = run(prepare_residual_problem(steady(20.0, -0.02, 500.0)), car())
    for row in (A_Y, YAW_RATE, V_Y):
        np.testing.assert_allclose(left[row], -right[row], atol=1e-12)
    np.testing.assert_allclose(left[A_X], right[A_X], atol=1e-12)


def test_longitudinal_acceleration_has_torque_drag_and_rolling_resistance() -> None:
    p = car(drag_area=0.8, rolling=0.01)
    out = run(prepare_residual_problem(steady(25.0, 0.0, 600.0)), p)
    spin = CAR.wheel_inertia * 4.0 / CAR.wheel_radius**2
    force = 600.0 / CAR.wheel_radius - 0.5 * AIR_DENSITY * 0.8 * 25.0**2
    force -= 0.01 * CAR.mass * GRAVITY
    assert out[A_X, -1] == pytest.approx(force / (CAR.mass + spin), rel=1e-3)


def test_an_accelerometer_does_not_measure_gravity_along_a_grade() -> None:
    flat, slope = (
        run(prepare_residual_problem(steady(20.0)), car(grade=grade, wheel_inertia=0.0))
        for grade in (0.0, 0.05)
    )
    np.testing.assert_allclose(flat[A_X], slope[A_X], atol=1e-9)
    # Gravity does slow the vehicle down.
    lost = flat[V_X, -1] - slope[V_X, -1]
    assert lost == pytest.approx(GRAVITY * math.sin(0.05) * 40.0, rel=1e-3)


@pytest.mark.parametrize("time", [0.0, 1e-4, 0.03, 0.5])
def test_a_first_order_lag_is_its_exact_solution(time: float) -> None:
    mean, after = first_order_lag(0.0, 1.0, lag_of(time, 0.01))
    if time == 0.0:
        assert (mean, after) == (1.0, 1.0)
        return
    fine = np.linspace(0.0, 0.01, 20001)
    exact = 1.0 - np.exp(-fine / time)
    assert after == pytest.approx(exact[-1], abs=1e-12)
    assert mean == pytest.approx(np.trapezoid(exact, fine) / 0.01, abs=1e-6)


def test_a_held_command_is_averaged_over_the_step() -> None:
    total = np.concatenate([[0.0], np.cumsum(np.repeat([1.0, 3.0], 10)) * 0.0025])
    assert zoh_mean(total, 0.0025, 0.02, 0.01) == pytest.approx(2.0)
    assert zoh_mean(total, 0.0025, -1.0, 0.01) == pytest.approx(1.0)
    assert zoh_mean(total, 0.0025, 9.0, 0.01) == pytest.approx(3.0)


def test_a_delay_shifts_the_response() -> None:
    straight = steady(20.0, 0.0, seconds=20.0)
    command = straight.command.copy()
    command[400:, 1] = 0.01
    problem = prepare_residual_problem(with_commands(straight, command))
    immediate = run(problem, car())[YAW_RATE]
    delayed = run(problem, car(steer_delay=0.2))[YAW_RATE]
    np.testing.assert_allclose(delayed[20:], immediate[:-20], atol=1e-9)


def test_backlash_reduces_the_amplitude_of_a_sine() -> None:
    log = steady(20.0, 0.0, seconds=30.0)
    swing = 0.02 * np.sin(2.0 * np.pi * 0.2 * log.command_s)
    problem = prepare_residual_problem(with_commands(log, np.column_stack([0.0 * swing, swing])))
    free = run(problem, car())[YAW_RATE, 1000:]
    slack = run(problem, car(steer_half_gap=0.004))[YAW_RATE, 1000:]
    assert np.max(np.abs(slack)) / np.max(np.abs(free)) == pytest.approx(0.8, abs=0.01)


def test_the_error_falls_with_the_step() -> None:
    angles = np.concatenate([[0.0], np.cumsum(0.02 * np.sin(0.003 * np.arange(4000)))]) * 0.0025
    torques = np.zeros_like(angles)
    ends = []
    for divide in (1, 2, 4, 16):
        step = 0.04 / divide
        n = round(8.0 / step)
        state = np.zeros(STATE_SIZE)
        state[S_V_X] = 20.0
        commands = CommandIntegrals(torques, angles, COMMAND_GRID_S)
        inputs = open_loop_inputs(commands, 0.0, step, n)
        inputs = inputs._replace(prescribed_v_x=np.full(n + 1, 20.0))
        integrate(car(), no_terms(n), inputs, run_buffers(state, n))
        ends.append(state[S_V_Y])
    errors = np.abs(np.array(ends[:3]) - ends[3])
    # The wheel loads lag by one step: a small error of first order.
    assert errors[2] < errors[1] < errors[0]
    assert errors[2] < 1e-3 * abs(ends[3]) + 1e-4


def test_the_grid_steps_are_ten_milliseconds_with_stamps_in_their_middles() -> None:
    problem = prepare_residual_problem(steady(20.0))
    assert problem.middle_s[0] == pytest.approx(problem.log.imu_s[0])
    assert np.diff(problem.middle_s) == pytest.approx(STEP_S)


def test_an_accelerometer_on_a_rolling_body_measures_gravity() -> None:
    gradient = 0.004
    rigid, rolling = (
        run(
            prepare_residual_problem(steady(20.0, 0.01, 300.0)),
            car(roll_gradient=x, pitch_gradient=x),
        )
        for x in (0.0, gradient)
    )
    for row in (A_X, A_Y):
        expected = rigid[row, -1] * (1.0 + GRAVITY * gradient)
        assert rolling[row, -1] == pytest.approx(expected, rel=1e-3)
    # The body angle affects the sensor only: the motion is the same.
    np.testing.assert_allclose(rolling[V_Y], rigid[V_Y], atol=1e-9)


def test_a_second_order_lag_rings_at_its_frequency_and_settles() -> None:
    step, frequency, damping = 0.0005, 10.0, 0.3
    value, rate, values = 0.0, 0.0, []
    for _ in range(20000):
        value, rate = second_order_lag(
            value, rate, 1.0, resonance_of(frequency, damping, step), step
        )
        values.append(value)
    overshoot = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    assert max(values) == pytest.approx(1.0 + overshoot, abs=0.01)
    peak = step * (int(np.argmax(values)) + 1)
    assert peak == pytest.approx(math.pi / (frequency * math.sqrt(1.0 - damping**2)), rel=0.01)
    assert values[-1] == pytest.approx(1.0, abs=1e-6)
    # Stable at any stiffness and step.
    assert second_order_lag(0.0, 0.0, 1.0, resonance_of(1e4, 1.0, 0.01), 0.01)[0] == pytest.approx(
        1.0, abs=0.05
    )


def test_both_tyre_curves_share_the_initial_slope_and_the_brush_model_saturates() -> None:
    for brush in (0.0, 0.4, 1.0):
        assert normalised_lateral_force(1e-5, 1.4, -0.3, brush) == pytest.approx(1.4e-5, rel=1e-4)
        assert normalised_lateral_force(-0.7, 1.4, -0.3, brush) == -normalised_lateral_force(
            0.7, 1.4, -0.3, brush
        )
    assert normalised_lateral_force(3.0 / 1.4, 1.4, 0.0, 1.0) == pytest.approx(1.0)
    assert normalised_lateral_force(50.0, 1.4, 0.0, 1.0) == 1.0
    # z = 1/2 gives 3/2 - 3/4 + 1/8.
    assert normalised_lateral_force(1.5 / 1.4, 1.4, 0.0, 1.0) == pytest.approx(0.875)
