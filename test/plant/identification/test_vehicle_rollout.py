# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The physics model as a predictor: batches, bounds against the plant, finiteness, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.identification.vehicle_rollout import actuator_states, driven_shares, rollout
from adk_ros.plant.scenario.scenario_file import load_scenario, scenarios
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.tyre import axle_tyre, combined_slip_utilisation
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle

CAR = load_vehicle("imdv")
HORIZON = 80


def windows(rows: FloatArray, starts: np.ndarray, begin: int) -> FloatArray:
    return np.stack([rows[i + begin : i + begin + HORIZON] for i in starts])


PLANAR = [name for name in scenarios() if load_scenario(name).plant == "seven_dof"]


@pytest.mark.parametrize("name", PLANAR)
def test_the_nominal_vehicle_stays_with_the_plant_for_two_seconds(name: str) -> None:
    """
    The floor of every prediction: right parameters, no noise, only the wheels simplified.

    What is left are commands that begin between two ticks, and slips the start does not tell.
    """
    scenario = load_scenario(name)
    drive = simulate(scenario, duration_s=90.0)
    starts = np.arange(40, len(drive.x) - HORIZON - 1, 10)
    truth = windows(drive.x, starts, 1)
    reached = actuator_states(drive.vehicle, drive.u)[starts]
    predicted = rollout(
        drive.vehicle,
        drive.x[starts],
        windows(drive.u, starts, 0),
        mu=scenario.mu,
        actuators=reached,
    )
    error = np.sqrt(np.square(predicted - truth).mean(axis=0))
    held = np.sqrt(np.square(drive.x[starts][:, None] - truth).mean(axis=0))
    assert np.all(error[-1] < [0.005, 0.002, 0.001]), error[-1]
    assert np.all(np.abs(predicted - truth).max(axis=(0, 1)) < [0.02, 0.02, 0.008])
    assert np.all(error[-1] < 0.01 * held[-1]), error[-1] / held[-1]
    assert np.all(error[0] < [0.001, 0.002, 0.0015]), error[0]


def test_a_batch_is_its_single_rollouts() -> None:
    rng = np.random.default_rng(3)
    x0 = rng.normal([18.0, 0.0, 0.0], [6.0, 0.5, 0.3], (7, 3))
    u = rng.normal([200.0, 0.0], [900.0, 0.05], (7, 30, 2))
    together = rollout(CAR, x0, u, 0.025)
    assert together.shape == (7, 30, 3)
    for i in range(7):
        np.testing.assert_array_equal(rollout(CAR, x0[i : i + 1], u[i : i + 1])[0], together[i])


def test_a_rollout_can_be_taken_in_pieces_of_dt() -> None:
    x0 = np.array([[20.0, 0.1, 0.05]])
    u = np.tile([500.0, 0.02], (1, 40, 1))
    coarse = rollout(CAR, x0, u, 0.025)
    fine = rollout(CAR, x0, np.repeat(u, 2, axis=1), 0.0125)
    np.testing.assert_allclose(fine[:, 1::2], coarse, atol=1e-12)


def test_left_and_right_mirror_each_other() -> None:
    rng = np.random.default_rng(4)
    x0 = rng.normal([18.0, 0.0, 0.0], [4.0, 0.5, 0.3], (5, 3))
    u = rng.normal([0.0, 0.0], [1500.0, 0.08], (5, 60, 2))
    there = rollout(CAR, x0, u)
    mirrored = rollout(CAR, x0 * [1.0, -1.0, -1.0], u * [1.0, -1.0])
    np.testing.assert_allclose(mirrored * [1.0, -1.0, -1.0], there, atol=1e-9)


def test_asked_for_a_force_the_tyre_gives_it_or_what_grip_allows() -> None:
    tyre = axle_tyre(CAR.constants(), True)
    for s_y in (0.0, 0.3, -0.6):
        n_x, n_y = driven_shares(tyre, 0.3, s_y)
        assert n_x == pytest.approx(0.3, rel=0.01)
        assert abs(n_y) <= abs(combined_slip_utilisation(tyre, 0.0, s_y)[1]) + 1e-9
    assert 0.8 < driven_shares(tyre, 1e9, 0.2)[0] <= 1.0
    assert -1.0 <= driven_shares(tyre, -1e9, 0.2)[0] < -0.8


def test_actuators_follow_their_commands() -> None:
    u = np.array([[0.0, 0.0]] + [[1000.0, 0.1]] * 40 + [[1e9, 9.0]] * 40)
    reached = actuator_states(CAR, u)
    np.testing.assert_array_equal(reached[:2], 0.0)
    rise = 1.0 - np.exp(-0.025 / CAR.torque_lag)
    assert reached[2, 0] == pytest.approx(1000.0 * rise)
    np.testing.assert_allclose(reached[41], [1000.0, 0.1], rtol=1e-6)
    np.testing.assert_allclose(reached[80], [CAR.max_drive_torque, CAR.max_steer], rtol=1e-6)


anything = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=60, deadline=None)
@given(
    x0=st.tuples(anything, anything, anything),
    u=st.lists(st.tuples(anything, anything), min_size=1, max_size=8),
    mu=anything,
    grade=anything,
)
def test_finite_for_any_finite_input(
    x0: tuple[float, ...], u: list[tuple[float, float]], mu: float, grade: float
) -> None:
    predicted = rollout(CAR, np.array([x0]), np.array([u]), mu=mu, grade=grade)
    assert np.isfinite(predicted).all()


def test_a_nan_spoils_its_own_row_only() -> None:
    x0 = np.array([[10.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [12.0, 0.0, 0.0]])
    predicted = rollout(CAR, x0, np.zeros((3, 5, 2)))
    assert np.isfinite(predicted[[0, 2]]).all()
    assert np.isnan(predicted[1]).any()


def test_nothing_to_do_is_no_fault() -> None:
    assert rollout(CAR, np.empty((0, 3)), np.empty((0, 5, 2))).shape == (0, 5, 3)
    assert rollout(CAR, np.ones((2, 3)), np.empty((2, 0, 2))).shape == (2, 0, 3)


@pytest.mark.parametrize(
    ("x0", "u", "said"),
    [
        ((3,), (1, 5, 2), r"x0 must have shape \(n, 3\)"),
        ((2, 3), (1, 5, 2), r"u must have shape"),
        ((2, 3), (2, 5, 3), r"u must have shape \(2, h, 2\)"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(
    x0: tuple[int, ...], u: tuple[int, ...], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        rollout(CAR, np.zeros(x0), np.zeros(u))


def test_other_arguments_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="dt must be"):
        rollout(CAR, np.zeros((1, 3)), np.zeros((1, 5, 2)), 0.0)
    with pytest.raises(ValueError, match="actuators must have shape"):
        rollout(CAR, np.zeros((1, 3)), np.zeros((1, 5, 2)), actuators=np.zeros(2))
