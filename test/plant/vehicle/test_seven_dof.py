# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Physics of the seven-degree-of-freedom plant: symmetry, balances, closed forms, convergence."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.plant.scenario.driver import understeer_gradient
from adk_ros.plant.vehicle.seven_dof import (
    DELTA,
    F_X_UTIL,
    F_Y_UTIL,
    HEADING,
    LOAD_A_Y,
    OMEGA,
    STATE_SIZE,
    V_X,
    V_Y,
    YAW_RATE,
    X,
    Y,
    advance,
    rolling_state,
)
from adk_ros.plant.vehicle.tyre import axle_tyre, combined_slip_utilisation, friction
from adk_ros.plant.vehicle.vehicle_forces import (
    LOAD_MIN,
    aerodynamic_forces,
    road_normal_weight,
    wheel_loads,
)
from adk_ros.plant.vehicle.vehicle_parameters import Constants, Tyre, Vehicle, load_vehicle

CAR = load_vehicle("imdv").constants()
FRICTIONLESS = CAR._replace(cda=0.0, crr=0.0, side_force_area=0.0, yaw_moment_volume=0.0)
WHEELBASE = CAR.cg_to_front_axle + CAR.cg_to_rear_axle
SPUN_MASS = CAR.mass + 4.0 * CAR.wheel_inertia / CAR.wheel_radius**2


def go(
    c: Constants,
    state: FloatArray,
    commands: list[tuple[float, float]],
    *,
    step: float = 1e-3,
    substeps: int = 25,
    road: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    states = np.empty((len(commands) + 1, STATE_SIZE))
    forces = np.empty((len(commands) + 1, 2))
    u = np.array(commands, dtype=np.float64)
    advance(c, state.copy(), u, np.array(road), step, substeps, states, forces)
    return states, forces


def moving(v_x: float, v_y: float, yaw_rate: float, delta: float = 0.0) -> FloatArray:
    state = rolling_state(CAR, v_x)
    state[V_Y], state[YAW_RATE], state[DELTA] = v_y, yaw_rate, delta
    return state


def test_left_and_right_mirror_each_other() -> None:
    rng = np.random.default_rng(0)
    commands = [
        (float(rng.uniform(-3000, 2500)), float(rng.uniform(-0.08, 0.12))) for _ in range(200)
    ]
    left, force_l = go(CAR, moving(20.0, 0.4, 0.2), commands)
    right, force_r = go(CAR, moving(20.0, -0.4, -0.2), [(t, -d) for t, d in commands])
    mirror = np.ones(STATE_SIZE)
    mirror[[V_Y, YAW_RATE, LOAD_A_Y, DELTA, Y, HEADING]] = -1.0
    mirror[F_Y_UTIL : F_Y_UTIL + 4] = -1.0
    order = np.arange(STATE_SIZE)
    for first in (OMEGA, F_X_UTIL, F_Y_UTIL):
        order[first : first + 4] = [first + 1, first, first + 3, first + 2]
    assert np.ptp(left[:, YAW_RATE]) > 0.3
    np.testing.assert_allclose(right[:, order] * mirror, left, atol=1e-9)
    np.testing.assert_allclose(force_r * [1.0, -1.0], force_l, atol=1e-9)


@given(
    a_x=st.floats(-100.0, 100.0), a_y=st.floats(-100.0, 100.0), weight=st.floats(100.0, 40000.0)
)
def test_wheel_loads_sum_to_the_weight(a_x: float, a_y: float, weight: float) -> None:
    loads = wheel_loads(CAR, a_x, a_y, weight)
    assert sum(loads) == pytest.approx(weight, rel=1e-12)
    assert min(loads) >= LOAD_MIN * (1.0 - 1e-12)


def test_load_transfer_is_that_of_a_rigid_body() -> None:
    weight = CAR.mass * GRAVITY
    still = np.array(wheel_loads(CAR, 0.0, 0.0, weight))
    np.testing.assert_allclose(still[:2].sum(), weight * CAR.cg_to_rear_axle / WHEELBASE)
    braked = np.array(wheel_loads(CAR, -3.0, 0.0, weight)) - still
    moment = (braked[2:].sum() - braked[:2].sum()) * WHEELBASE / 2.0
    assert moment == pytest.approx(-3.0 * CAR.mass * CAR.cg_height)
    left_turn = np.array(wheel_loads(CAR, 0.0, 4.0, weight)) - still
    moment = (left_turn[[1, 3]].sum() - left_turn[[0, 2]].sum()) * CAR.track_width / 2.0
    assert moment == pytest.approx(4.0 * CAR.mass * CAR.cg_height)


def test_weight_on_a_bank() -> None:
    level = road_normal_weight(CAR.mass, 0.0, 0.0, 20.0, 0.2)
    assert level == pytest.approx(CAR.mass * GRAVITY)
    adverse = road_normal_weight(CAR.mass, 0.0, 0.1, 20.0, 0.2)
    expected = CAR.mass * (GRAVITY * math.cos(0.1) - 20.0 * 0.2 * math.sin(0.1))
    assert adverse == pytest.approx(expected)


@given(s_x=st.floats(-1e3, 1e3), s_y=st.floats(-1e3, 1e3))
def test_combined_force_stays_within_the_friction_limit(s_x: float, s_y: float) -> None:
    n_x, n_y = combined_slip_utilisation(axle_tyre(CAR, True), s_x, s_y)
    assert math.hypot(n_x, n_y) <= 1.0 + 1e-9
    assert n_x * s_x >= 0.0
    assert n_y * s_y >= 0.0


def test_pure_slip_is_the_magic_formula() -> None:
    for slip in (-0.5, -0.05, 0.003, 0.1, 0.8):
        bent = 9.5 * slip
        expected = math.sin(1.4 * math.atan(bent + 0.4 * (bent - math.atan(bent))))
        n_x, n_y = combined_slip_utilisation(axle_tyre(CAR, True), 0.0, bent)
        assert n_y == pytest.approx(expected, rel=1e-6)
        assert n_x == 0.0


def test_friction_falls_with_load() -> None:
    tyre = axle_tyre(CAR, False)._replace(mu=1.2, load_sensitivity=0.1, nominal_load=5000.0)
    assert friction(tyre, 5000.0) == pytest.approx(1.2)
    assert friction(tyre, 10000.0) == pytest.approx(1.08)
    assert friction(tyre, 1e9) == pytest.approx(0.24)


@pytest.mark.parametrize(
    ("v_x", "v_y", "yaw_rate", "delta"),
    [
        (25.0, 0.0, 0.0, 0.0),
        (20.0, 0.0, 0.0, 0.05),
        (15.0, 3.0, 1.0, 0.0),
        (-10.0, 1.0, 0.5, 0.1),
        (30.0, -8.0, 2.0, 0.3),
        (2.0, 0.0, 0.0, 0.2),
        (0.0, 5.0, 3.0, 0.0),
    ],
)
def test_coasting_never_gains_energy(
    v_x: float, v_y: float, yaw_rate: float, delta: float
) -> None:
    states, _ = go(CAR, moving(v_x, v_y, yaw_rate, delta), [(0.0, delta)] * 800, substeps=5)
    spin = 0.5 * CAR.wheel_inertia * np.square(states[:, OMEGA : OMEGA + 4]).sum(axis=1)
    energy = 0.5 * CAR.mass * np.square(states[:, [V_X, V_Y]]).sum(axis=1) + spin
    energy += 0.5 * CAR.yaw_inertia * np.square(states[:, YAW_RATE])
    assert np.all(np.diff(energy) < 0.0)


@pytest.mark.parametrize("v_x", [5.0, 10.0, 20.0, 30.0])
def test_steady_circle_has_the_closed_form_understeer(v_x: float) -> None:
    """Linear single-track car: r = v delta / (L + K v^2), K from masses and slip stiffnesses."""
    load_f = CAR.mass * GRAVITY * CAR.cg_to_rear_axle / WHEELBASE
    load_r = CAR.mass * GRAVITY * CAR.cg_to_front_axle / WHEELBASE
    stiff_f = CAR.b_y_f * CAR.c_y_f * load_f * friction(axle_tyre(CAR, True), load_f / 2.0)
    stiff_r = CAR.b_y_r * CAR.c_y_r * load_r * friction(axle_tyre(CAR, False), load_r / 2.0)
    gradient = (
        CAR.mass / WHEELBASE * (CAR.cg_to_rear_axle / stiff_f - CAR.cg_to_front_axle / stiff_r)
    )
    assert understeer_gradient(CAR) == pytest.approx(gradient, rel=1e-9)
    delta = 0.3 * (WHEELBASE / v_x**2 + gradient)
    states, forces = go(FRICTIONLESS, rolling_state(CAR, v_x), [(0.0, delta)] * 400)
    speed = math.hypot(states[-1, V_X], states[-1, V_Y])
    expected = speed * delta / (WHEELBASE + gradient * speed**2)
    assert states[-1, YAW_RATE] == pytest.approx(expected, rel=5e-4)
    assert forces[-1, 1] == pytest.approx(speed * states[-1, YAW_RATE], rel=2e-3)


def test_coast_down_under_drag_alone_has_the_closed_form() -> None:
    """m' dv/dt = -k v^2 gives v = v0 / (1 + k v0 t / m'), m' with the wheels' spin in it."""
    c = CAR._replace(crr=0.0)
    states, _ = go(c, rolling_state(c, 30.0), [(0.0, 0.0)] * 400)
    k = 0.5 * AIR_DENSITY * c.cda
    t = 0.025 * np.arange(401)
    np.testing.assert_allclose(states[:, V_X], 30.0 / (1.0 + k * 30.0 * t / SPUN_MASS), rtol=2e-4)


def test_constant_torque_accelerates_mass_and_rotating_inertia() -> None:
    states, forces = go(FRICTIONLESS, rolling_state(CAR, 10.0), [(1000.0, 0.0)] * 120)
    accel = (states[120, V_X] - states[40, V_X]) / 2.0
    assert accel == pytest.approx(1000.0 / CAR.wheel_radius / SPUN_MASS, rel=2e-3)
    assert forces[-1, 0] == pytest.approx(accel, rel=1e-2)


def test_specific_force_on_a_slope() -> None:
    """Driven uphill at constant speed it reads +g sin(grade); rolling freely it reads nothing."""
    grade = 0.05
    torque = CAR.mass * GRAVITY * math.sin(grade) * CAR.wheel_radius
    road = (1.0, grade, 0.0, 0.0, 0.0)
    states, forces = go(FRICTIONLESS, rolling_state(CAR, 10.0), [(torque, 0.0)] * 200, road=road)
    assert forces[-1, 0] == pytest.approx(GRAVITY * math.sin(grade), rel=1e-3)
    assert states[-1, V_X] == pytest.approx(states[100, V_X], abs=2e-3)
    _, free = go(FRICTIONLESS, rolling_state(CAR, 10.0), [(0.0, 0.0)] * 200, road=road)
    spins = 1.0 - CAR.mass / SPUN_MASS
    assert free[-1, 0] == pytest.approx(spins * GRAVITY * math.sin(grade), rel=0.02)


def test_hard_braking_is_limited_by_friction() -> None:
    _, forces = go(CAR, rolling_state(CAR, 25.0), [(-9000.0, 0.0)] * 40, road=(0.5, 0, 0, 0, 0))
    grip = 0.5 * CAR.mu_f * GRAVITY
    assert -1.1 * grip < forces[20:40, 0].min() < -0.6 * grip


def test_crosswind_causes_drift_and_yaw() -> None:
    f_x, f_y, m_z = aerodynamic_forces(CAR, 20.0, 0.0, 0.0, -8.0)
    pressure = 0.5 * AIR_DENSITY * math.hypot(20.0, 8.0)
    assert f_x == pytest.approx(-pressure * CAR.cda * 20.0)
    assert f_y == pytest.approx(-pressure * CAR.side_force_area * 8.0)
    assert m_z == pytest.approx(-pressure * CAR.yaw_moment_volume * 8.0)


def test_the_integrator_is_of_fourth_order() -> None:
    start, command = moving(15.0, 0.3, 0.1), [(800.0, 0.05)]

    def end(steps: int) -> FloatArray:
        states, _ = go(CAR, start, command, step=0.2 / steps, substeps=steps)
        return np.asarray(states[-1])

    fine = end(12800)
    errors = [float(np.abs(end(n) - fine)[[V_X, V_Y, YAW_RATE]].max()) for n in (200, 400, 800)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.7), orders
    assert np.all(orders < 4.6), orders
    assert errors[0] < 1e-8, "the plant's own step of 1 ms"


def test_standstill_and_reverse() -> None:
    states, _ = go(CAR, rolling_state(CAR, 0.0), [(0.0, 0.3)] * 80)
    assert np.abs(states[:, [V_X, V_Y, YAW_RATE]]).max() < 1e-9
    states, _ = go(CAR, rolling_state(CAR, 0.0), [(-600.0, 0.2)] * 160)
    assert states[-1, V_X] < -2.0
    assert states[-1, YAW_RATE] < 0.0, "backwards with the wheels to the left"


anything = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=60, deadline=None)
@given(
    start=st.lists(anything, min_size=STATE_SIZE, max_size=STATE_SIZE),
    commands=st.lists(st.tuples(anything, anything), min_size=1, max_size=4),
    mu=anything,
    grade=anything,
    bank=anything,
)
def test_finite_for_any_finite_input(
    start: list[float], commands: list[tuple[float, float]], mu: float, grade: float, bank: float
) -> None:
    states, forces = go(CAR, np.array(start), commands, road=(mu, grade, bank, 0.0, 0.0))
    assert np.isfinite(states).all()
    assert np.isfinite(forces).all()


@settings(max_examples=40, deadline=None)
@given(
    mass=st.floats(50.0, 1e5),
    yaw_inertia=st.floats(10.0, 1e6),
    front=st.floats(0.2, 10.0),
    rear=st.floats(0.2, 10.0),
    track=st.floats(0.3, 5.0),
    height=st.floats(0.0, 4.0),
    b_y=st.floats(1.0, 40.0),
    lag=st.floats(0.0, 5.0),
    relaxation=st.floats(0.0, 5.0),
)
def test_finite_for_any_vehicle(
    mass: float,
    yaw_inertia: float,
    front: float,
    rear: float,
    track: float,
    height: float,
    b_y: float,
    lag: float,
    relaxation: float,
) -> None:
    tyre = Tyre(
        mu=1.0,
        b_x=1.0,
        c_x=1.0,
        e_x=0.0,
        b_y=b_y,
        c_y=1.9,
        e_y=1.0,
        nominal_load=5000.0,
        load_sensitivity=0.5,
        relaxation_length=relaxation,
        relaxation_length_x=1.0,
    )
    car = Vehicle(
        mass=mass,
        yaw_inertia=yaw_inertia,
        cg_to_front_axle=front,
        cg_to_rear_axle=rear,
        track_width=track,
        cg_height=height,
        wheel_inertia=5.0,
        front_tyre=tyre,
        rear_tyre=tyre,
        torque_lag=lag,
        steer_lag=lag,
        load_lag=min(lag, 1.0),
    )
    states, forces = go(
        car.constants(), moving(40.0, -5.0, 3.0), [(3000.0, 0.6), (-9000.0, -0.6)] * 5
    )
    assert np.isfinite(states).all()
    assert np.isfinite(forces).all()
    assert np.abs(states[:, X]).max() < 1e9
