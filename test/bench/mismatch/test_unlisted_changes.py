# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Changes outside the catalogue act in the equations of their labels, and only there."""

from __future__ import annotations

from typing import Any

import numba  # type: ignore[import-untyped, unused-ignore]
import numpy as np
import pytest

from adk_ros.bench.mismatch.sensor_dropouts import DROPOUTS, with_dropouts
from adk_ros.bench.mismatch.unlisted_labels import FORM_OF, UNLISTED_IN, describe_unlisted
from adk_ros.mismatch.recording.simulated_sensors import simulate_faulty_sensors
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.injection.injected_changes import InjectedChanges, act, start_memory
from adk_ros.plant.injection.injected_drive import simulate_injected_drive
from adk_ros.plant.injection.injectors import UNLISTED, plant_changes
from adk_ros.plant.injection.unlisted_changes import MEMORY_SIZE, Motion, UnlistedChanges
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.vehicle.vehicle_parameters import Constants, load_vehicle

EQUATIONS = ("v_x", "v_y", "yaw_rate")
LEAST = {"v_x": 0.04, "v_y": 0.04, "yaw_rate": 0.02}
"""RMS acceleration that a change must make in an equation, m/s² and rad/s²."""


@numba.njit
def actions(c: Any, h: Any, truth: Any, commands: Any, lap: float) -> Any:
    """Return torque, angle and added accelerations (n, 5) along a given drive."""
    out = np.empty((truth.shape[0], 5))
    memory = np.zeros(MEMORY_SIZE)
    start_memory(memory, commands[0, 0], commands[0, 1])
    for n in range(truth.shape[0]):
        row = truth[n]
        motion = Motion(row[9], row[8], lap, row[3], row[4], row[2], row[7], row[1])
        a = act(c, h, motion, commands, n, memory)
        out[n] = (a.torque, a.delta, a.added_x, a.added_y, a.added_yaw)
    return out


@pytest.fixture(scope="module")
def drive() -> tuple[Constants, FloatArray, FloatArray, float]:
    vehicle, route = load_vehicle("imdv"), load_scenario("handling").planned_route()
    truth, commands, _ = simulate_injected_drive(
        vehicle, vehicle, route, InjectedChanges(), 1, 150.0
    )
    return vehicle.constants(), truth[:-1], commands, route.length


def changed(drive: Any, name: str, size: float) -> dict[str, FloatArray]:
    """Return by equation the accelerations (n,) that a change makes along the same drive."""
    c, truth, commands, lap = drive
    plain = actions(c, InjectedChanges(), truth, commands, lap)
    with_change = actions(c, plant_changes({}, {name: size}, 0.0), truth, commands, lap)
    d = with_change - plain
    # A change of the steering angle turns the front axle's force.
    stiffness = c.b_y_f * c.c_y_f * c.mu_f * 0.5 * c.mass * 9.81
    return {
        "v_x": d[:, 0] / (c.wheel_radius * c.mass) + d[:, 2],
        "v_y": stiffness * d[:, 1] / c.mass + d[:, 3],
        "yaw_rate": c.cg_to_front_axle * stiffness * d[:, 1] / c.yaw_inertia + d[:, 4],
    }


def test_every_change_has_a_size_a_field_and_a_description() -> None:
    assert set(UNLISTED) == set(UnlistedChanges._fields) == set(UNLISTED_IN) == set(FORM_OF)
    assert len(UNLISTED) + len(DROPOUTS) >= 30


@pytest.mark.slow
@pytest.mark.parametrize("name", UNLISTED)
def test_a_change_acts_in_the_equations_of_its_label(drive: Any, name: str) -> None:
    found = changed(drive, name, UNLISTED[name])
    rms = {key: float(np.sqrt(np.mean(x**2))) for key, x in found.items()}
    equations = UNLISTED_IN[name][0]
    for equation in EQUATIONS:
        if equation in equations:
            assert rms[equation] > LEAST[equation], rms
        else:
            assert rms[equation] < 1e-12, rms


@pytest.mark.slow
def test_brakes_fade_with_the_work_done(drive: Any) -> None:
    c, _, commands, _ = drive
    lost = changed(drive, "brake_fade", 0.5)["v_x"]
    torque = np.repeat(commands[:, 0], 25)[: lost.size] / (c.wheel_radius * c.mass)
    hard = torque < -1.0
    share = -lost[hard] / torque[hard]
    early, late = share[: share.size // 10], share[-share.size // 3 :]
    assert early.mean() < 0.5 * late.mean()
    assert share.min() >= 0.0
    assert share.max() < 0.5
    np.testing.assert_allclose(lost[torque > 0.1], 0.0)


def test_a_differential_locks_under_torque(drive: Any) -> None:
    _, truth, commands, _ = drive
    yaw = changed(drive, "torque_locking_differential", 0.03)["yaw_rate"]
    torque = np.repeat(commands[:, 0], 25)[: yaw.size]
    np.testing.assert_allclose(yaw, -0.03 * np.abs(torque) * truth[:, 2] / truth[:, 3])


def test_a_wheel_imbalance_oscillates_once_per_turn(drive: Any) -> None:
    _, truth, _, _ = drive
    along = changed(drive, "wheel_imbalance", 0.6)["v_x"]
    turns = np.sum(np.diff(np.sign(along)) > 0)
    assert turns == pytest.approx((truth[-1, 8] - truth[0, 8]) / (2 * np.pi * 0.325), rel=0.02)


def test_a_lap_periodic_moment_repeats_every_lap(drive: Any) -> None:
    _, truth, _, lap = drive
    yaw = changed(drive, "lap_periodic_yaw", 0.15)["yaw_rate"]
    np.testing.assert_allclose(yaw, 0.15 * np.sin(10.0 * np.pi * truth[:, 8] / lap), atol=1e-9)


def test_gusts_come_one_at_a_time_from_both_sides(drive: Any) -> None:
    found = changed(drive, "gust_series", 1.2)
    across = found["v_y"]
    blowing = np.abs(across) > 0.0
    assert np.sum(np.diff(blowing.astype(int)) == 1) in {12, 13}
    assert 0.03 < blowing.mean() < 0.1
    assert across.max() == pytest.approx(1.2, rel=1e-3)
    assert across.min() == pytest.approx(-1.2, rel=1e-3)


def test_friction_in_the_driveline_opposes_changes_of_torque(drive: Any) -> None:
    c, _, _, _ = drive
    time = np.arange(0.0, 8.0, 1e-3)
    truth = np.zeros((time.size, 11))
    truth[:, 3], truth[:, 9] = 20.0, time
    commands = np.zeros((time.size // 25 + 1, 2))
    commands[:, 0] = 1000.0 * np.sin(0.5 * np.pi * 0.025 * np.arange(commands.shape[0]))
    h = plant_changes({}, {"torque_hysteresis": 150.0}, 0.0)
    given = np.repeat(commands[:, 0], 25)[: time.size]
    lost = given - actions(c, h, truth, commands, 1000.0)[:, 0]
    rising = np.gradient(np.sin(0.5 * np.pi * time)) > 1e-3
    assert lost[rising & (time > 3.5)].mean() > 120.0
    assert np.abs(lost).max() <= 150.0 + 1e-9


def test_a_dropout_touches_one_sensor_only() -> None:
    truth, commands = np.zeros((60001, 11)), np.zeros((2401, 2))
    truth[:, 3] = np.linspace(0.0, 60.0, 60001)
    truth[:, 0] = truth[:, 3]
    log = simulate_faulty_sensors("drive", truth, commands, {}, None)
    for name, share in DROPOUTS.items():
        faulty = with_dropouts(log, {name: share}, np.random.default_rng(1))
        sensor, fault = name.split("_")
        values, times = (log.imu, log.imu_s) if sensor == "imu" else (log.odometry, log.odometry_s)
        new, at = (
            (faulty.imu, faulty.imu_s) if sensor == "imu" else (faulty.odometry, faulty.odometry_s)
        )
        if fault == "missing":
            lost = 1.0 - at.size / times.size
            np.testing.assert_array_equal(new[:, 0], values[np.isin(times, at), 0])
        else:
            lost = float(np.mean(np.diff(new[:, 0]) == 0.0))
            np.testing.assert_array_equal(times, at)
        assert 0.4 * share < lost < 1.3 * share
        kept = faulty.odometry if sensor == "imu" else faulty.imu
        np.testing.assert_array_equal(kept, log.odometry if sensor == "imu" else log.imu)


def test_labels_state_what_a_right_answer_describes() -> None:
    label = {"effects": [{"name": "unknown", "params": {}}]}
    (fade,) = describe_unlisted(label, {"brake_fade": 0.5})["effects"]
    assert fade["equations"] == ["v_x"]
    assert "brake_torque" in fade["driven_by"]
    (frozen,) = describe_unlisted(label, {"imu_frozen": 0.03})["effects"]
    assert frozen["accepts"] == ["none", "unknown"]
    assert "equations" not in frozen
