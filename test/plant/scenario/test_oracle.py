# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Oracle predictor: the plant continued from its own states reproduces the drive."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.plant.scenario.oracle import oracle_rollout
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.scenario.simulate import simulate

AHEAD = 80


@pytest.fixture(scope="module", params=["handling", "xyz_edges", "slalom", "gusts", "winter"])
def drive(request: pytest.FixtureRequest) -> SimulatedDrive:
    return simulate(load_scenario(request.param), duration_s=40.0)


def test_started_from_the_truth_the_oracle_is_the_drive(drive: SimulatedDrive) -> None:
    rows = np.array([0, 1, 7, 400, 777, 1200, len(drive.x) - 1 - AHEAD])
    driven = oracle_rollout(drive, rows, drive.x[rows], AHEAD)
    truth = np.stack([drive.x[row + 1 : row + 1 + AHEAD] for row in rows])
    assert driven.shape == (7, AHEAD, 3)
    assert np.abs(driven - truth).max() < 1e-9
    assert np.ptp(truth[:, :, 0]) > 1.0


def test_only_the_measurement_error_separates_oracle_and_drive(drive: SimulatedDrive) -> None:
    rows = np.arange(100, 1500, 100)
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, [0.02, 0.02, 0.002], (len(rows), 3))
    driven = oracle_rollout(drive, rows, drive.x[rows] + noise, AHEAD)
    truth = np.stack([drive.x[row + 1 : row + 1 + AHEAD] for row in rows])
    error = np.sqrt(np.square(driven - truth).mean(axis=0))
    assert np.all(error[0] < [0.04, 0.04, 0.008])
    # A wrong speed stays wrong; a wrong sideslip and yaw rate die out on tyres that hold.
    assert 0.003 < error[-1, 0] < 0.06
    assert np.all(error[-1, 1:] < [0.03, 0.004])
    # The wheels go along with the measured speed: no jerk as they find their slip again.
    assert np.abs((driven - truth)[:, 0, 0] - noise[:, 0]).max() < 0.02


def test_starts_are_independent(drive: SimulatedDrive) -> None:
    rows = np.array([300, 500, 300])
    x0 = drive.x[rows] + [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.1, 0.0, 0.0]]
    together = oracle_rollout(drive, rows, x0, 20)
    np.testing.assert_array_equal(together[0], together[2])
    np.testing.assert_array_equal(oracle_rollout(drive, rows[1:2], x0[1:2], 20)[0], together[1])
    before = drive.states.copy()
    oracle_rollout(drive, rows, x0 + 1.0, 20)
    np.testing.assert_array_equal(drive.states, before)


def test_a_nan_measurement_gives_a_nan_prediction(drive: SimulatedDrive) -> None:
    x0 = drive.x[[10, 20]].copy()
    x0[0, 1] = np.nan
    driven = oracle_rollout(drive, np.array([10, 20]), x0, 5)
    assert np.isnan(driven[0]).all()
    assert np.isfinite(driven[1]).all()


def test_after_the_end_the_last_command_holds(drive: SimulatedDrive) -> None:
    last = len(drive.x) - 1
    driven = oracle_rollout(drive, np.array([last]), drive.x[[last]], 40)
    assert np.isfinite(driven).all()
    assert np.abs(np.diff(driven[0], axis=0)).max() < 1.0


def test_invalid_arguments_are_refused() -> None:
    drive = simulate(load_scenario("town"), duration_s=2.0)
    none = np.array([], dtype=np.int64)
    assert oracle_rollout(drive, none, np.empty((0, 3)), 5).shape == (0, 5, 3)
    for rows, x0, ahead, said in (
        ([81], np.zeros((1, 3)), 5, "rows must be in the grid of the drive, 0 to 80"),
        ([-1], np.zeros((1, 3)), 5, "rows must be"),
        ([1, 2], np.zeros((1, 3)), 5, "x0 must have shape"),
        ([1], np.zeros((1, 3)), -1, "ahead must not be negative"),
    ):
        with pytest.raises(ValueError, match=said):
            oracle_rollout(drive, np.array(rows), x0, ahead)
