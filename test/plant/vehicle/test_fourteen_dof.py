# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Physics of the fourteen-degree-of-freedom plant: symmetry, balances, closed forms, limits."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from helpers.plant import (
    AIRLESS,
    IMDV,
    LEVEL,
    NO_AIR,
    NO_LIFT,
    Car,
    car,
    changed,
    energy,
    go,
    rolling,
    settled,
    tyre_forces,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.plant.environment.surface import even_planes
from adk_ros.plant.scenario.driver import understeer_gradient
from adk_ros.plant.vehicle import seven_dof
from adk_ros.plant.vehicle.fourteen_dof import (
    BRAKE,
    DELTA,
    F_X_UTIL,
    F_Y_UTIL,
    HEADING,
    MOTOR,
    OMEGA,
    PITCH,
    ROLL,
    ROLL_RATE,
    STATE_SIZE,
    TRAVEL,
    TRAVEL_RATE,
    V_X,
    V_Y,
    V_Z,
    YAW_RATE,
    Y,
    Z,
)
from adk_ros.plant.vehicle.sprung_mass import resolve, vertical_modes
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle

WHEELBASE = IMDV.c.cg_to_front_axle + IMDV.c.cg_to_rear_axle
PER_WHEEL = (OMEGA, F_X_UTIL, F_Y_UTIL, TRAVEL, TRAVEL_RATE, MOTOR, BRAKE)


def moving(car: Car, v_x: float, v_y: float, yaw_rate: float, delta: float = 0.0) -> FloatArray:
    state = settled(car, v_x=v_x)
    state[V_X], state[V_Y], state[YAW_RATE], state[DELTA] = v_x, v_y, yaw_rate, delta
    return state


def test_left_and_right_mirror_each_other() -> None:
    rng = np.random.default_rng(0)
    commands = [
        (float(rng.uniform(-5000, 2500)), float(rng.uniform(-0.08, 0.12))) for _ in range(200)
    ]
    start = moving(IMDV, 25.0, 0.4, 0.2)
    start[ROLL], start[ROLL_RATE] = 0.02, -0.1
    mirror = np.ones(STATE_SIZE)
    mirror[[V_Y, YAW_RATE, ROLL_RATE, DELTA, Y, HEADING, ROLL]] = -1.0
    mirror[F_Y_UTIL : F_Y_UTIL + 4] = -1.0
    order = np.arange(STATE_SIZE)
    for first in PER_WHEEL:
        order[first : first + 4] = [first + 1, first, first + 3, first + 2]
    left, force_l = go(IMDV, start, commands)
    right, force_r = go(IMDV, start[order] * mirror, [(t, -d) for t, d in commands])
    assert np.ptp(left[:, YAW_RATE]) > 0.3
    assert np.ptp(left[:, ROLL]) > 0.03
    np.testing.assert_allclose(right[:, order] * mirror, left, atol=1e-8)
    np.testing.assert_allclose(force_r * [1.0, -1.0], force_l, atol=1e-7)


@pytest.mark.parametrize("name", ["imdv", "race_car", "light_truck"])
def test_at_rest_the_wheels_carry_the_weight(name: str) -> None:
    here = changed(name)
    rest = settled(here)
    loads = tyre_forces(here, rest)
    assert loads.sum() == pytest.approx(here.c.mass * GRAVITY, rel=1e-6)
    wheelbase = here.c.cg_to_front_axle + here.c.cg_to_rear_axle
    front = here.c.mass * GRAVITY * here.c.cg_to_rear_axle / wheelbase
    assert loads[:2].sum() == pytest.approx(front, rel=1e-5)
    np.testing.assert_allclose(rest[TRAVEL : TRAVEL + 4], 0.0, atol=1e-5)
    np.testing.assert_allclose(rest[[ROLL, PITCH]], 0.0, atol=1e-5)


def test_wheel_loads_balance_the_vertical_momentum() -> None:
    """d(vertical momentum of body and wheels)/dt = loads + lift - weight."""
    c, b = AIRLESS
    start = rolling(AIRLESS, 20.0)
    start[Z] += 0.04
    start[PITCH] = 0.02
    states, _ = go(AIRLESS, start, [(-4000.0, 0.0)] * 1500, substeps=1)
    cos, sin = np.cos(states[:, PITCH]), np.sin(states[:, PITCH])
    masses = np.array([b.unsprung_f] * 2 + [b.unsprung_r] * 2)
    wheels = states[:, TRAVEL_RATE : TRAVEL_RATE + 4] @ masses
    # Centre of gravity at P at rest: pitching alone moves no mass up.
    upwards = -sin * c.mass * states[:, V_X] + cos * (c.mass * states[:, V_Z] + wheels)
    pushes = np.array([tyre_forces(AIRLESS, state).sum() for state in states])
    pushes -= c.mass * GRAVITY
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * (pushes[1:] + pushes[:-1])) * 1e-3])
    assert np.abs(pushes).max() > 0.3 * c.mass * GRAVITY
    error = upwards - upwards[0] - impulse
    assert np.abs(error).max() < 0.01 * np.abs(impulse).max()


@pytest.mark.parametrize("grade", [0.0, 0.08])
@pytest.mark.parametrize(
    ("v_x", "v_y", "yaw_rate", "delta"),
    [(25.0, 0.0, 0.0, 0.0), (20.0, 0.0, 0.0, 0.05), (15.0, 3.0, 1.0, 0.0), (30.0, -8.0, 2.0, 0.3)],
)
def test_coasting_never_gains_energy(
    v_x: float, v_y: float, yaw_rate: float, delta: float, grade: float
) -> None:
    """Gravity, springs and tyres included; on the hill the car gains speed and loses height."""
    planes = even_planes(1.0, grade, 0.0, heading=2.5)
    start = rolling(IMDV, v_x, planes)
    start[V_Y], start[YAW_RATE], start[DELTA] = v_y, yaw_rate, delta
    states, _ = go(IMDV, start, [(0.0, delta)] * 800, substeps=5, planes=planes)
    total = np.array([energy(IMDV, state, planes) for state in states])
    kinetic = 0.5 * IMDV.c.mass * v_x**2
    assert np.diff(total).max() < 1e-5 * kinetic
    assert total[-1] < total[0] - 1e-3 * kinetic


def test_energy_loss_while_coasting_equals_drag_work() -> None:
    """Straight ahead, energy is dissipated only by air drag and rolling resistance."""
    c = IMDV.c
    states, _ = go(IMDV, settled(IMDV, v_x=30.0), [(0.0, 0.0)] * 400)
    total = np.array([energy(IMDV, state) for state in states])
    v = states[:, V_X]
    lift = 0.5 * AIR_DENSITY * (IMDV.b.lift_area_f + IMDV.b.lift_area_r) * v**2
    power = 0.5 * AIR_DENSITY * c.cda * v**3 + c.crr * (c.mass * GRAVITY - lift) * v
    work = np.cumsum(0.5 * (power[1:] + power[:-1])) * 0.025
    np.testing.assert_allclose(total[0] - total[1:], work, rtol=0.01, atol=20.0)


@pytest.mark.parametrize("v_x", [8.0, 15.0, 25.0])
def test_steady_circle_has_the_closed_form_understeer(v_x: float) -> None:
    """As the planar model at small roll: r = v delta / (L + K v²)."""
    c = AIRLESS.c
    gradient = understeer_gradient(c)
    delta = 0.3 * (WHEELBASE / v_x**2 + gradient)
    states, forces = go(AIRLESS, settled(AIRLESS, v_x=v_x), [(0.0, delta)] * 400)
    speed = math.hypot(states[-1, V_X], states[-1, V_Y])
    expected = speed * delta / (WHEELBASE + gradient * speed**2)
    assert states[-1, YAW_RATE] == pytest.approx(expected, rel=2e-3)
    # Strapped to the body, the accelerometer leans outwards with it.
    leaning = GRAVITY * math.sin(states[-1, ROLL])
    assert forces[-1, 1] == pytest.approx(speed * states[-1, YAW_RATE] + leaning, rel=5e-3)


def test_steady_roll_has_the_closed_form() -> None:
    """
    phi = m a_y h' / (K_springs - m g h) + tyres, h' the height over the roll axis.

    The axles' springs and bars, less what the links carry, then the tyres in series.
    """
    c, b = AIRLESS
    states, _ = go(AIRLESS, settled(AIRLESS, v_x=15.0), [(40.0, 0.03)] * 320)
    last = states[-1]
    a_y = last[V_X] * last[YAW_RATE]
    square = 0.5 * c.track_width**2
    springs = (b.spring_f + 2.0 * b.bar_f + b.spring_r + 2.0 * b.bar_r) * square
    tyres = (b.tyre_stiffness_f + b.tyre_stiffness_r) * square
    side = 0.5 * c.mass * (a_y + GRAVITY * last[ROLL])
    links = side * (b.roll_centre_f + b.roll_centre_r) * a_y / (a_y + GRAVITY * last[ROLL])
    tipping = c.mass * c.cg_height * (a_y + GRAVITY * last[ROLL])
    expected = (tipping - links) / springs + tipping / tyres
    assert last[ROLL] == pytest.approx(expected, rel=0.02)
    assert math.degrees(last[ROLL]) > 1.0


def test_the_integrator_is_of_fourth_order() -> None:
    start, command = moving(IMDV, 15.0, 0.3, 0.1), [(800.0, 0.05)]

    def end(steps: int) -> FloatArray:
        states, _ = go(IMDV, start, command, step=0.2 / steps, substeps=steps)
        return np.asarray(states[-1])

    fine = end(12800)
    chosen = [V_X, V_Y, YAW_RATE, ROLL, PITCH, TRAVEL]
    errors = [float(np.abs(end(n) - fine)[chosen].max()) for n in (200, 400, 800)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.7), orders
    assert np.all(orders < 4.6), orders
    assert errors[0] < 1e-7, "the plant's own step of 1 ms"


def test_with_stiff_springs_it_equals_the_planar_model() -> None:
    stiff = {
        f"{part}_{axle}": value
        for axle in ("front", "rear")
        for part, value in (
            ("spring", 4e6), ("damper", 4e4), ("anti_roll", 0.0), ("tyre_stiffness", 2e7),
            ("tyre_damping", 1.5e4), ("roll_centre", 0.0), ("unsprung_mass", 100.0),
        )
    } | NO_LIFT  # fmt: skip
    # Drag and rolling resistance tip the car here; the planar one takes them for road forces.
    here = changed(chassis=stiff, roll_share_front=0.5, load_lag=0.0, **NO_AIR)
    t = 0.025 * np.arange(320)
    commands = [(300.0, float(d)) for d in 0.035 * np.sin(2.0 * np.pi * 0.5 * t)]
    states, forces = go(here, settled(here, v_x=20.0), commands)
    planar = np.empty((321, seven_dof.STATE_SIZE))
    felt = np.empty((321, 2))
    start = seven_dof.rolling_state(here.c, states[0, V_X])
    start[seven_dof.OMEGA : seven_dof.OMEGA + 4] = states[0, OMEGA : OMEGA + 4]
    road = np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    seven_dof.advance(here.c, start, np.array(commands), road, 1e-3, 25, planar, felt)
    largest = np.abs(planar[:, :3]).max(axis=0)
    error = np.abs(states[:, :3] - planar[:, :3]).max(axis=0) / largest
    assert np.all(error < [1e-4, 0.005, 0.001]), error
    assert np.abs(forces - felt).max(axis=0)[1] < 0.02 * np.abs(felt[:, 1]).max()
    soft, _ = go(IMDV, settled(IMDV, v_x=20.0), commands)
    apart = np.abs(soft[:, :3] - planar[:, :3]).max(axis=0) / largest
    assert np.all(apart[1:] > 3.0 * error[1:]), "what springs change is more than that"


def test_specific_force_on_a_slope() -> None:
    grade = 0.08
    planes = even_planes(1.0, grade)
    torque = AIRLESS.c.mass * GRAVITY * math.sin(grade) * AIRLESS.c.wheel_radius
    start = rolling(AIRLESS, 10.0, planes)
    states, forces = go(AIRLESS, start, [(torque, 0.0)] * 320, planes=planes)
    v = states[:, V_X]
    assert v[-1] == pytest.approx(v[160], abs=5e-3)
    # The nose lifts a little more than the road: the body is what the sensor is strapped to.
    assert forces[-1, 0] == pytest.approx(-GRAVITY * math.sin(states[-1, PITCH]), rel=1e-5)
    assert 0.0 < -states[-1, PITCH] - grade < 0.006
    stiff = changed(chassis=NO_LIFT | {"spring_front": 2e6, "spring_rear": 2e6}, **NO_AIR)
    _, forces = go(stiff, rolling(stiff, 10.0, planes), [(torque, 0.0)] * 320, planes=planes)
    assert forces[-1, 0] == pytest.approx(GRAVITY * math.sin(grade), rel=0.01)
    climbed = np.diff(states[:, Z])[160:] / 0.025
    np.testing.assert_allclose(climbed, v[161:] * math.sin(grade), rtol=2e-3)


def test_specific_force_on_a_bank() -> None:
    """Held straight by steering, the accelerometer reads g sin(bank), roll included."""
    bank = 0.06
    planes = even_planes(1.0, 0.0, bank)
    state = rolling(IMDV, 20.0, planes)
    felt = np.zeros(2)
    for _ in range(600):
        delta = -0.3 * state[HEADING] - 0.02 * state[Y] - 0.02 * state[V_Y]
        states, forces = go(IMDV, state, [(200.0, float(delta))], planes=planes)
        state, felt = states[-1], forces[-1]
    assert abs(state[YAW_RATE]) < 1e-4
    assert felt[1] == pytest.approx(-math.sin(-state[ROLL]) * GRAVITY, rel=5e-3)
    assert felt[1] == pytest.approx(GRAVITY * math.sin(bank), rel=0.15)
    loads = tyre_forces(IMDV, state, planes)
    assert loads[1] + loads[3] > loads[0] + loads[2], "the lower side carries more"


def test_heave_has_the_quarter_car_eigenvalue() -> None:
    """One spring and one mass over the tyre's spring: damped eigenvalue of two masses."""
    vehicle = load_vehicle("imdv")
    even = {
        f"{part}_{axle}": value
        for axle in ("front", "rear")
        for part, value in (
            ("spring", 32000.0),
            ("damper", 900.0),
            ("tyre_damping", 0.0),
            ("roll_centre", 0.0),
        )
    }
    content = vehicle.model_dump() | {"cg_to_front_axle": 1.335, "cg_to_rear_axle": 1.335}
    content["chassis"] = content["chassis"] | even
    vehicle = Vehicle.model_validate(content)
    here = car(vehicle)
    b = here.b
    lower = np.array([
        [-32000.0, 32000.0, -900.0, 900.0],
        [32000.0, -32000.0 - b.tyre_stiffness_f, 900.0, -900.0],
    ]) / np.array([[0.25 * b.sprung_mass], [b.unsprung_f]])  # fmt: skip
    quarter = np.linalg.eigvals(np.vstack([np.eye(4)[2:], lower]))
    heave = quarter[np.argmin(np.abs(quarter))]
    modes = vertical_modes(vehicle, b)
    assert np.abs(modes - heave).min() < 1e-6 * abs(heave)
    start = settled(here)
    start[V_Z] = 0.15
    states, _ = go(here, start, [(0.0, 0.0)] * 3000, substeps=1)
    lift = states[:, Z] - start[Z]
    crossings = np.flatnonzero(np.diff(np.sign(lift)) > 0)[1:4] * 1e-3
    hertz = 1.0 / np.diff(crossings).mean()
    assert hertz == pytest.approx(abs(heave.imag) / (2.0 * np.pi), rel=0.01)
    assert hertz == pytest.approx(1.3, abs=0.15)


def test_downforce_increases_wheel_loads() -> None:
    here = changed("race_car")
    states, _ = go(here, settled(here, v_x=60.0), [(900.0, 0.0)] * 80)
    v = states[-1, V_X]
    pressed = -0.5 * AIR_DENSITY * v**2 * (here.b.lift_area_f + here.b.lift_area_r)
    assert pressed > 0.3 * here.c.mass * GRAVITY
    loads = tyre_forces(here, states[-1])
    assert loads.sum() == pytest.approx(here.c.mass * GRAVITY + pressed, rel=2e-3)


def test_wheel_load_is_never_negative() -> None:
    tall = changed(cg_height=0.9, chassis={"anti_roll_front": 1.2e5, "anti_roll_rear": 0.0})
    states, _ = go(tall, settled(tall, v_x=18.0), [(0.0, 0.07)] * 120)
    loads = np.array([tyre_forces(tall, state) for state in states])
    assert loads.min() == 0.0
    assert loads.sum(axis=1)[40:].mean() == pytest.approx(tall.c.mass * GRAVITY, rel=0.05)
    assert np.degrees(states[:, ROLL]).max() < 15.0, "three wheels carry it"
    thrown = rolling(IMDV, 20.0)
    thrown[Z] += 0.5
    fell, _ = go(AIRLESS, thrown, [(0.0, 0.0)] * 40, substeps=5)
    assert tyre_forces(AIRLESS, fell[0]).max() == 0.0
    # The wheels are thrown down by their springs, the body up; together they fall as a stone.
    wheels = fell[:, TRAVEL : TRAVEL + 4].sum(axis=1) * AIRLESS.b.unsprung_f / AIRLESS.c.mass
    falling = fell[:, Z] + wheels - thrown[Z]
    assert np.ptp(wheels) > 0.01
    np.testing.assert_allclose(falling, -0.5 * GRAVITY * (0.005 * np.arange(41)) ** 2, atol=1e-4)


def test_friction_brakes_complement_the_motors() -> None:
    states, _ = go(IMDV, settled(IMDV, v_x=30.0), [(-2400.0, 0.0)] * 20)
    np.testing.assert_allclose(states[-1, MOTOR : MOTOR + 4], -600.0, rtol=1e-3)
    assert states[-1, BRAKE : BRAKE + 4].max() == 0.0
    states, forces = go(IMDV, settled(IMDV, v_x=30.0), [(-4500.0, 0.0)] * 40)
    np.testing.assert_allclose(states[-1, MOTOR : MOTOR + 4], -750.0, rtol=1e-3)
    brakes = states[-1, BRAKE : BRAKE + 4]
    np.testing.assert_allclose(brakes, [450.0, 450.0, 300.0, 300.0], rtol=1e-3)
    decel = (states[-1, V_X] - states[-5, V_X]) / 0.1
    drag = 0.5 * AIR_DENSITY * 0.7 * states[-1, V_X] ** 2 / 2070.0 + 0.012 * GRAVITY
    assert decel == pytest.approx(-4500.0 / 0.325 / 2070.0 / 1.024 - drag, rel=0.02)
    leaning = GRAVITY * math.sin(states[-1, PITCH])
    assert forces[-1, 0] == pytest.approx(decel - leaning, rel=0.01)


def test_brakes_hold_and_motors_reverse() -> None:
    uphill = even_planes(1.0, 0.1)
    braked = changed(chassis={"motor_limit_front": 0.0, "motor_limit_rear": 0.0})
    start = rolling(braked, 0.0, uphill)
    states, forces = go(braked, start, [(-6000.0, 0.0)] * 160, planes=uphill)
    assert abs(states[-1, V_X]) < 0.25, "it creeps: brakes and tyres are smooth at standstill"
    assert forces[-1, 0] == pytest.approx(-GRAVITY * math.sin(states[-1, PITCH]), rel=0.01)
    states, _ = go(IMDV, rolling(IMDV, 0.0), [(-600.0, 0.2)] * 160)
    assert states[-1, V_X] < -2.0
    assert states[-1, YAW_RATE] < 0.0, "backwards with the wheels to the left"


def test_standstill_is_an_equilibrium() -> None:
    states, _ = go(IMDV, rolling(IMDV, 0.0), [(0.0, 0.3)] * 80)
    assert np.abs(states[:, [V_X, V_Y, YAW_RATE, V_Z]]).max() < 1e-9


def test_crosswind_causes_drift_and_roll() -> None:
    states, forces = go(IMDV, settled(IMDV, v_x=25.0), [(150.0, 0.0)] * 40, wind=(0.0, -12.0))
    pressure = 0.5 * AIR_DENSITY * math.hypot(states[1, V_X], 12.0)
    blown = -pressure * IMDV.c.side_force_area * 12.0 / IMDV.c.mass
    assert forces[0, 1] == pytest.approx(blown, rel=0.02)
    assert states[-1, Y] < -0.05
    assert states[-1, ROLL] > 1e-4, "away from the wind, about tyres that hold"


def test_cost_is_below_three_planar_plants() -> None:
    """By ratio, on the same machine at the same time; 1400 s in 15 s leave more than that."""
    commands = [(300.0, 0.02)] * 400
    u, road = np.array(commands), np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    states, forces = np.empty((401, seven_dof.STATE_SIZE)), np.empty((401, 2))
    start = rolling(IMDV, 20.0)
    cost: dict[str, float] = {"seven": np.inf, "fourteen": np.inf}
    for _ in range(6):
        begin = time.perf_counter()
        seven_dof.advance(
            IMDV.c, seven_dof.rolling_state(IMDV.c, 20.0), u, road, 1e-3, 25, states, forces
        )
        middle = time.perf_counter()
        go(IMDV, start, commands)
        cost["seven"] = min(cost["seven"], middle - begin)
        cost["fourteen"] = min(cost["fourteen"], time.perf_counter() - middle)
    assert cost["fourteen"] < 3.0 * cost["seven"], cost


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
    planes = even_planes(mu, grade, bank)
    states, forces = go(IMDV, np.array(start), commands, planes=planes)
    assert np.isfinite(states).all()
    assert np.isfinite(forces).all()


@settings(max_examples=40, deadline=None)
@given(
    mass=st.floats(50.0, 1e5),
    gyration=st.floats(0.3, 2.0),
    front=st.floats(0.3, 8.0),
    share=st.floats(0.25, 4.0),
    track=st.floats(0.3, 5.0),
    height=st.floats(0.0, 4.0),
    roll_centre=st.floats(-0.5, 1.0),
    lift=st.floats(-20.0, 20.0),
)
def test_finite_for_any_valid_vehicle(
    mass: float,
    gyration: float,
    front: float,
    share: float,
    track: float,
    height: float,
    roll_centre: float,
    lift: float,
) -> None:
    """Defaults follow the masses: an unusual vehicle needs no additional keys."""
    rear = front * share
    content = {
        "mass": mass, "yaw_inertia": min(max(mass * gyration * front * rear, 10.0), 1e6),
        "cg_to_front_axle": front, "cg_to_rear_axle": min(max(rear, 0.2), 10.0),
        "track_width": track, "cg_height": height, "wheel_inertia": 50.0,
        "chassis": {"roll_centre_front": roll_centre, "lift_area_front": lift},
    }  # fmt: skip
    refused = ""
    try:
        vehicle = Vehicle.model_validate(content)
    except ValueError as error:
        refused = str(error)
    if refused:
        assert "chassis: " in refused or "too light" in refused
        return
    here = Car(vehicle.constants(), resolve(vehicle))
    start = rolling(here, 40.0)
    start[V_Y], start[YAW_RATE] = -5.0, 3.0
    states, forces = go(here, start, [(3000.0, 0.6), (-9000.0, -0.6)] * 5)
    assert np.isfinite(states).all()
    assert np.isfinite(forces).all()


def test_vehicles_at_rest_stay_at_rest() -> None:
    """Every packaged vehicle stands still where it was put, on a plane in any direction."""
    for name in ("imdv", "race_car", "light_truck"):
        here = changed(name)
        states, _ = go(here, rolling(here, 0.0, x=5.0, y=-3.0, heading=2.0), [(0.0, 0.0)] * 40)
        np.testing.assert_allclose(states[-1], states[0], atol=1e-6)
    assert LEVEL.shape == (4, 5)
    assert set(NO_AIR) < set(Vehicle.model_fields)
