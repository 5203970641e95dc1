# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The multi-body plant of generated cases: the package's own equations, and exact effects."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from adk_ros.bench.mismatch.case_generator import InjectedMismatch, make_case
from adk_ros.bench.vehicles import multibody
from adk_ros.bench.vehicles.multibody import MULTI_BODY, base_vehicle
from adk_ros.bench.vehicles.multibody_changes import EFFECTS, SIZES, changed_multibody
from adk_ros.bench.vehicles.multibody_drive import simulate_multibody_drive
from adk_ros.bench.vehicles.vehicle_family import TOLERANCE, MultibodyFamily
from adk_ros.errors import UsageError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.injection.injectors import FULL, plant_changes
from adk_ros.plant.scenario.random_routes import ROAD_STYLES, plan_route, random_route

A_X, A_Y, RATE, V_X, V_Y = range(5)
YAW_ACCELERATION = 10


def drive(name: str, seconds: float = 30.0, **sizes: float) -> tuple[FloatArray, FloatArray]:
    """Return truth and commands of a drive with an effect, "" for none."""
    roads = ROAD_STYLES["track"]
    segments, _ = random_route(np.random.default_rng(3), roads)
    effects = {name: sizes or SIZES.get(name, FULL[name])} if name else {}
    vehicle = base_vehicle()
    return simulate_multibody_drive(
        vehicle, changed_multibody(vehicle, effects), plan_route(segments, [], roads, 4.5),
        plant_changes(effects, {}, 0.0), 5, seconds,
    )  # fmt: skip


@pytest.fixture(scope="module")
def plain() -> tuple[FloatArray, FloatArray]:
    return drive("")


@pytest.mark.slow
def test_the_equations_are_those_of_the_package() -> None:
    theirs = parameters_vehicle2()
    compiled = multibody.model()
    rng = np.random.default_rng(1)
    state = np.array(compiled.start_state([0.0, 0.0, 0.02, 18.0, 0.1, 0.2, 0.01], theirs))
    state[5:] += 1e-3 * rng.standard_normal(24)
    expected = vehicle_dynamics_mb(list(state), [0.0, 1.5], theirs)
    found = compiled.rates(state.copy(), (0.0, 1.5), base_vehicle().parameters())
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.slow
def test_the_specific_force_fits_the_motion(plain: tuple[FloatArray, FloatArray]) -> None:
    truth, _ = plain
    for force, velocity, other, sign in ((A_X, V_X, V_Y, -1.0), (A_Y, V_Y, V_X, 1.0)):
        motion = np.gradient(truth[:, velocity], 1e-3) + sign * truth[:, RATE] * truth[:, other]
        assert np.std(motion - truth[:, force]) < 0.05
    assert np.abs(truth[:, V_Y]).max() < 2.0


@pytest.mark.slow
def test_effects_change_what_they_are_called(plain: tuple[FloatArray, FloatArray]) -> None:
    """Compare the balance of forces of both drives with the injected parameter."""
    vehicle = base_vehicle().equivalent()

    def per_torque(name: str) -> float:
        """Return the longitudinal acceleration per driving torque, 1/(kg m)."""
        truth, commands = drive(name) if name else plain
        torque = np.repeat(commands[:, 0], 25)[: truth.shape[0]]
        rows = (np.abs(truth[:, A_Y]) < 1.0) & (torque > 0.0)
        return float(np.polyfit(torque[rows], truth[rows, A_X], 1)[0])

    base = per_torque("")
    spin = 4.0 * vehicle.wheel_inertia / vehicle.wheel_radius**2
    assert base == pytest.approx(1.0 / (vehicle.wheel_radius * (vehicle.mass + spin)), rel=0.05)
    heavier = (vehicle.mass + spin) / (vehicle.mass + spin + SIZES["payload"]["mass"])
    assert per_torque("payload") / base == pytest.approx(heavier, rel=0.02)
    assert per_torque("drive_torque_gain") / base == pytest.approx(0.86, rel=0.02)
    turning = vehicle.mass + spin + SIZES["rotating_inertia"]["inertia"] / 0.344**2
    assert per_torque("rotating_inertia") / base == pytest.approx(
        (vehicle.mass + spin) / turning, rel=0.04
    )


@pytest.mark.slow
def test_softer_tyres_change_the_understeer(plain: tuple[FloatArray, FloatArray]) -> None:
    def angle(truth: FloatArray, commands: FloatArray) -> float:
        """Return the steering angle beyond Ackermann's per lateral acceleration, rad s²/m."""
        delta = np.repeat(commands[:, 1], 25)[: truth.shape[0]]
        ackermann = 2.579 * truth[:, RATE] / truth[:, V_X]
        return float(np.polyfit(truth[:, A_Y], delta - ackermann, 1)[0])

    base = angle(*plain)
    assert angle(*drive("front_tyre_stiffness")) > base + 5e-4
    assert angle(*drive("rear_tyre_stiffness")) < base - 5e-4


@pytest.mark.slow
def test_a_car_that_spins_is_driven_again_at_a_lower_speed() -> None:
    truth, _ = drive("low_friction", 60.0, mu_scale=0.4)
    assert np.isinf(truth[-1]).all()
    slippery = InjectedMismatch({"low_friction": FULL["low_friction"]})
    case = make_case("slippery", slippery, 3, MULTI_BODY, (12.0, 40.0, 20.0))
    assert np.isfinite(case.recording.odometry).all()
    assert np.abs(case.recording.odometry[:, 1]).max() < 3.5


def test_tolerances_are_small_and_sizes_exact() -> None:
    rng, family = np.random.default_rng(2), MultibodyFamily()
    vehicle = family.random_vehicle(rng, windy=True)
    built = family.with_tolerances(rng, vehicle)
    for mine, other in ((built.body, vehicle.body), (built.front, vehicle.front)):
        for name, value in mine.items():
            assert value == pytest.approx(other[name], rel=TOLERANCE)
    assert built.body != vehicle.body
    loaded = family.changed(built, {"payload": {"mass": 100.0}})
    assert loaded.body["m"] - built.body["m"] == pytest.approx(100.0)
    assert loaded.body["I_z"] - built.body["I_z"] == pytest.approx(110.0)
    softer = family.changed(built, {"rear_tyre_stiffness": {"scale": 0.8}})
    assert softer.rear["p_ky1"] == pytest.approx(0.8 * built.rear["p_ky1"])
    assert softer.front == built.front
    assert len(EFFECTS) >= 20
    assert family.nominal(vehicle).mass == vehicle.body["m"]


@pytest.mark.slow
def test_a_case_has_both_sides_of_the_same_car() -> None:
    case = make_case(
        "one", InjectedMismatch({"yaw_inertia": {"scale": 1.3}}), 7, MULTI_BODY, (12.0, 12.0, 8.0)
    )
    assert case.label["effects"][0]["params"] == {"scale": 1.3}
    assert 900.0 < case.nominal.mass < 1400.0
    assert np.isfinite(case.recording.odometry).all()
    assert case.simulation.odometry[:, 0].min() > 5.0


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "vehiclemodels.parameters_vehicle2", None)
    with pytest.raises(UsageError, match="pip install commonroad-vehicle-models"):
        multibody.base_parameters.__wrapped__()


@pytest.mark.slow
def test_an_axle_softens_by_more_than_the_coefficient_of_its_tyres() -> None:
    """The stiffness of both axles, from the forces and slip angles below 4 m/s²."""

    def stiffness(name: str) -> FloatArray:
        truth, commands = drive(name, 60.0)
        body = base_vehicle().body
        a, b, rows = body["a"], body["b"], slice(2000, None, 10)
        delta = np.repeat(commands[:, 1], -(-truth.shape[0] // commands.shape[0]))
        moment, side = body["I_z"] * truth[rows, YAW_ACCELERATION], body["m"] * truth[rows, A_Y]
        force = np.array([b * side + moment, a * side - moment]) / (a + b)
        v_x, v_y, rate = (truth[rows, i] for i in (V_X, V_Y, RATE))
        slip = np.array([
            delta[: truth.shape[0]][rows] - (v_y + a * rate) / v_x, (b * rate - v_y) / v_x
        ])  # fmt: skip
        used = np.abs(truth[rows, A_Y]) < 4.0
        return np.array(
            [np.polyfit(x[used], y[used], 1)[0] for x, y in zip(slip, force, strict=True)]
        )

    before = stiffness("")
    front = stiffness("front_tyre_stiffness") / before
    rear = stiffness("rear_tyre_stiffness") / before
    assert FULL["front_tyre_stiffness"]["scale"] == FULL["rear_tyre_stiffness"]["scale"] == 0.72
    np.testing.assert_allclose(front, [0.66, 1.0], atol=0.02)
    np.testing.assert_allclose(rear, [1.0, 0.67], atol=0.02)
