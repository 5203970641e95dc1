# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A vehicle's parameters from its drives: known changes are found, and nothing is made up."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
import pytest

from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.identification.identify_vehicle import (
    DEFAULT_PARAMETERS,
    IdentifiedVehicle,
    VehicleParameter,
    actuator_state_history,
    identify_vehicle,
)
from adk_ros.plant.identification.vehicle_rollout import MAX_STEP, actuator_states, rollout
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.vehicle_parameters import Constants, Vehicle, load_vehicle
from adk_ros.signals.channels import Record

CAR = load_vehicle("imdv")
MU = load_scenario("handling").mu

CHANGES: dict[str, Any] = {
    "mass": 2230.0,
    "yaw_inertia": 3000.0,
    "cg_to_front_axle": 1.285,
    "cg_to_rear_axle": 1.385,
    "cda": 0.9,
    "steer_lag": 0.06,
    "front_tyre": CAR.front_tyre.model_dump() | {"mu": 0.95, "b_y": 9.0},
    "rear_tyre": CAR.rear_tyre.model_dump() | {"mu": 1.0, "b_y": 12.5},
}


@functools.cache
def drive(changed: bool) -> Record:
    scenario = load_scenario("handling")
    changes = CHANGES if changed else {}
    scenario = scenario.model_copy(update={"vehicle_changes": changes, "seed": 4})
    return simulate(scenario, duration_s=120.0).truth()


@functools.cache
def tuned() -> IdentifiedVehicle:
    return identify_vehicle(CAR, [drive(True)], mu=MU, count=250, ahead=30)


def stiffness(c: Constants) -> FloatArray:
    """B C D over load: what the slope of the force is made of."""
    return np.array([c.b_y_f * c.c_y_f * c.mu_f, c.b_y_r * c.c_y_r * c.mu_r])


def wrong_by(vehicle: Vehicle, record: Record) -> FloatArray:
    """RMS of the errors (3,) after 1 s."""
    rows = np.arange(40, len(record) - 41, 10)
    u = record.u[rows[:, None] + np.arange(40)]
    at = actuator_states(vehicle, record.u)[rows]
    last = rollout(vehicle, record.x[rows], u, actuators=at, mu=MU)[:, -1]
    return np.asarray(np.sqrt(np.square(last - record.x[rows + 40]).mean(axis=0)))


@pytest.mark.slow
def test_changed_parameters_are_found() -> None:
    true, found = CAR.model_copy(update=CHANGES), tuned().vehicle
    for name, tolerance in (
        ("mass", 0.005),
        ("yaw_inertia", 0.04),
        ("cg_to_front_axle", 0.005),
        ("cda", 0.04),
        ("steer_lag", 0.15),
        ("torque_lag", 0.15),
        ("crr", 0.1),
    ):
        assert getattr(found, name) == pytest.approx(getattr(true, name), rel=tolerance), name
    front, rear = CHANGES["front_tyre"], CHANGES["rear_tyre"]
    slope = [front["b_y"] * front["c_y"] * front["mu"], rear["b_y"] * rear["c_y"] * rear["mu"]]
    np.testing.assert_allclose(stiffness(found.constants()), slope, rtol=0.01)
    assert found.front_tyre.mu == pytest.approx(0.95, rel=0.05)
    assert found.rear_tyre.mu == pytest.approx(1.0, rel=0.05)
    assert found.cg_to_front_axle + found.cg_to_rear_axle == pytest.approx(2.67)


@pytest.mark.slow
def test_what_is_reported_is_what_was_found() -> None:
    result = tuned()
    assert set(result.changes) == set(result.deviation) == {q.name for q in DEFAULT_PARAMETERS}
    assert result.cost_after < 0.05 * result.cost_before
    assert result.at_bound == ()
    assert result.changes["mass"] == pytest.approx(result.vehicle.mass / CAR.mass)
    shift = result.vehicle.cg_to_front_axle - CAR.cg_to_front_axle
    assert result.changes["centre of gravity"] == pytest.approx(shift)
    assert all(
        0.0 < d <= q.prior_sigma * 1.001
        for q, d in zip(DEFAULT_PARAMETERS, result.deviation.values(), strict=True)
    )
    # What no drive excites is known no better than before; what all of it tells of, far better.
    assert result.deviation["mass"] < 0.01 * next(
        q.prior_sigma for q in DEFAULT_PARAMETERS if q.name == "mass"
    )


@pytest.mark.slow
def test_it_drives_like_the_car_on_another_drive() -> None:
    scenario = load_scenario("town").model_copy(update={"vehicle_changes": CHANGES, "mu": MU})
    other = simulate(scenario, duration_s=40.0).truth()
    assert (wrong_by(tuned().vehicle, other) < 0.2 * wrong_by(CAR, other)).all()


def test_the_right_vehicle_is_left_as_it_is() -> None:
    few = [
        q
        for q in DEFAULT_PARAMETERS
        if q.name in ("mass", "drag", "stiffness front", "stiffness rear")
    ]
    result = identify_vehicle(CAR, [drive(False)], parameters=few, mu=MU, count=120, ahead=30)
    for name in ("mass", "stiffness front", "stiffness rear"):
        assert result.changes[name] == pytest.approx(1.0, abs=0.01), name
    assert result.vehicle.yaw_inertia == CAR.yaw_inertia
    assert result.cost_after <= result.cost_before


def test_noise_and_wild_samples_do_not_lead_it_away() -> None:
    random = np.random.default_rng(0)
    record = drive(True)
    x = record.x + random.normal(0.0, [0.02, 0.02, 0.002], record.x.shape)
    wild = random.random(len(record)) < 0.02
    x[wild] += random.normal(0.0, 2.0, (int(wild.sum()), 3))
    noisy = dataclasses.replace(record, x=x, x_ref=x)
    few = [
        q
        for q in DEFAULT_PARAMETERS
        if q.name
        in (
            "mass",
            "stiffness front",
            "grip front",
            "yaw inertia",
            "stiffness rear",
            "grip rear",
            "centre of gravity",
            "drag",
            "steering lag",
        )
    ]
    found = identify_vehicle(CAR, [noisy], parameters=few, mu=MU, count=250, ahead=30).vehicle
    assert found.mass == pytest.approx(2230.0, rel=0.03)
    front, rear = CHANGES["front_tyre"], CHANGES["rear_tyre"]
    slope = [front["b_y"] * front["c_y"] * front["mu"], rear["b_y"] * rear["c_y"] * rear["mu"]]
    np.testing.assert_allclose(stiffness(found.constants()), slope, rtol=0.05)


def test_bounds_hold_and_are_told() -> None:
    mass, drag = {"mass": 1.0}, {"cda": 1.0}
    narrow = (VehicleParameter("mass", mass, 0.1, 0.02), VehicleParameter("drag", drag, 0.2, 1.0))
    result = identify_vehicle(CAR, [drive(True)], parameters=narrow, mu=MU, count=100, ahead=20)
    assert result.at_bound == ("mass",)
    assert result.vehicle.mass == pytest.approx(CAR.mass * np.exp(0.02))
    lag = (VehicleParameter("torque lag", {"torque_lag": 1.0}, 0.03, 0.5, shift=True),)
    quick = CAR.model_copy(update={"torque_lag": 0.0})
    result = identify_vehicle(quick, [drive(False)], parameters=lag, mu=MU, count=60)
    assert result.vehicle.torque_lag == pytest.approx(0.03, abs=0.003)
    slow = simulate(
        load_scenario("town").model_copy(update={"vehicle_changes": {"torque_lag": 0.0}}),
        duration_s=30.0,
    ).truth()
    result = identify_vehicle(CAR, [slow], parameters=lag, mu=MU, count=60)
    # The model cannot tell lags apart that are shorter than its step.
    assert 0.0 <= result.vehicle.torque_lag <= MAX_STEP
    assert result.deviation["torque lag"] > 0.5 * MAX_STEP


def test_several_records_are_used_in_proportion() -> None:
    whole = drive(True)
    parts = [whole.rows(slice(0, 1500)), whole.rows(slice(1500, None))]
    few = (
        VehicleParameter("mass", {"mass": 1.0}, 0.1, 0.5),
        VehicleParameter("drag", {"cda": 1.0}, 0.2, 1.0),
    )
    one = identify_vehicle(CAR, [whole], parameters=few, mu=MU, count=100, ahead=20)
    two = identify_vehicle(CAR, parts, parameters=few, mu=MU, count=100, ahead=20)
    assert two.vehicle.mass == pytest.approx(one.vehicle.mass, rel=0.01)


def test_too_little_is_refused() -> None:
    with pytest.raises(DataError, match=r"cannot be identified from 0 starts .* at least 50"):
        identify_vehicle(CAR, [drive(True).rows(slice(0, 20))])
    standing = dataclasses.replace(drive(True), x=np.zeros_like(drive(True).x))
    with pytest.raises(DataError, match="more than 3 m/s"):
        identify_vehicle(CAR, [standing])


def test_actuators_hold_the_last_command_over_a_gap() -> None:
    """Training, identification and rollouts share this function: one rule for gaps."""
    record = drive(True).rows(slice(0, 200))
    u, held = record.u.copy(), record.u.copy()
    u[80:90] = np.nan
    held[80:90] = held[79]
    with_gap = dataclasses.replace(record, u=u)
    states = actuator_state_history(CAR, with_gap)
    np.testing.assert_array_equal(states, actuator_states(CAR, held))
    np.testing.assert_array_equal(actuator_state_history(CAR, record, u), states)
    u[:5] = np.nan
    late = actuator_state_history(CAR, dataclasses.replace(record, u=u))
    assert np.isnan(late[:5]).all()
    np.testing.assert_array_equal(late[5:], actuator_states(CAR, held[5:]))


def test_actuators_start_afresh_in_a_new_episode() -> None:
    record = drive(True).rows(slice(0, 200))
    episode = record.episode + (np.arange(200) >= 120)
    states = actuator_state_history(CAR, dataclasses.replace(record, episode=episode))
    np.testing.assert_array_equal(states[:120], actuator_states(CAR, record.u[:120]))
    np.testing.assert_array_equal(states[120:], actuator_states(CAR, record.u[120:]))
