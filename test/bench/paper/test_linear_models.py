# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Least squares without lifting on known linear systems; the predictor protocol."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from adk_ros.bench.paper.linear_models import LeastSquares, pairs
from adk_ros.bench.paper.predictor_protocol import BenchPredictor
from adk_ros.bench.paper.seven_dof_predictor import SevenDof
from adk_ros.errors import DataError
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle
from adk_ros.signals.channels import TICK_NS, Flag, Record

A = np.array([[0.99, 0.01, 0.0], [0.005, 0.9, -0.2], [0.0, 0.03, 0.85]])
B = np.array([[2e-4, 0.1], [0.0, 1.5], [1e-5, 3.0]])
C = np.array([0.15, 0.0, 0.01])


def record(
    n: int = 400, a: FloatArray = A, b: FloatArray = B, seed: int = 0, noise: float = 0.0
) -> Record:
    """Return a record of x_(k+1) = a x_k + b u_k + C at about 15 m/s."""
    random = np.random.default_rng(seed)
    u = random.normal(0.0, [300.0, 0.03], (n, 2)).cumsum(axis=0) * 0.1
    u -= u.mean(axis=0)
    x = np.empty((n, 3))
    x[0] = 15.0, 0.1, 0.1
    for k in range(n - 1):
        x[k + 1] = a @ x[k] + b @ u[k] + C
    x += noise * random.normal(size=x.shape)
    zeros = np.zeros(n, dtype=np.int64)
    stamps = np.arange(n, dtype=np.int64) * TICK_NS
    return Record(stamps, x, u, np.zeros((n, 2)), zeros, x.copy(), zeros.copy(), "linear")


def truth(drive: Record, rows: np.ndarray, ahead: int) -> FloatArray:
    return drive.x_ref[rows[:, None] + np.arange(1, ahead + 1)]


def test_a_linear_system_is_identified_exactly() -> None:
    drive = record()
    fitted = LeastSquares.fit([drive])
    a, b, c = fitted.matrices()
    np.testing.assert_allclose(a, A, atol=1e-9)
    np.testing.assert_allclose(b, B, atol=1e-9)
    np.testing.assert_allclose(c, C, atol=1e-7)
    rows = np.arange(5, 300, 7)
    predicted = fitted.predict(drive, rows, 80)
    np.testing.assert_allclose(predicted, truth(drive, rows, 80), atol=1e-8)


def test_unlearnable_samples_are_left_out() -> None:
    drive = record()
    wrong = drive.x.copy()
    wrong[50:60] += 3.0
    wrong[70] = np.nan
    flags = drive.flags.copy()
    flags[50:60] = int(Flag.FROZEN)
    episode = (np.arange(len(drive)) >= 200).astype(np.int64)
    wrong[200:] = record(seed=1).x[200:]
    u = drive.u.copy()
    u[200:] = record(seed=1).u[200:]
    damaged = dataclasses.replace(drive, x=wrong, u=u, flags=flags, episode=episode)
    kept = pairs(damaged)
    assert kept.sum() == len(drive) - 1 - 11 - 2 - 1
    assert not kept[[49, 59, 69, 70, 199]].any()
    a, b, _ = LeastSquares.fit([damaged]).matrices()
    np.testing.assert_allclose(a, A, atol=1e-9)
    np.testing.assert_allclose(b, B, atol=1e-9)


def test_too_little_is_refused() -> None:
    with pytest.raises(DataError, match=r"ten pairs .* use longer recordings"):
        LeastSquares.fit([record().rows(slice(0, 8))])
    with pytest.raises(DataError, match="have 0"):
        LeastSquares.fit([])


def test_adaptation_identifies_a_changed_system() -> None:
    changed = A + np.array([[0.0, 0.0, 0.0], [0.0, -0.1, 0.05], [0.0, 0.0, -0.1]])
    train, drive = record(), record(n=1500, a=changed, seed=2)
    settings = OnlineSettings(window=400, ridge=1e-3)
    offline, online = LeastSquares.fit([train]), LeastSquares.fit([train], settings)
    assert (offline.name, online.name) == ("least squares", "adapted least squares")
    rows = np.arange(1000, 1400, 10)
    errors = [
        np.abs(p.predict(drive, rows, 40) - truth(drive, rows, 40)).max(axis=(0, 1))
        for p in (offline, online)
    ]
    assert (errors[1] < 1e-3 * errors[0]).all(), errors


def test_adaptation_equals_the_batch_solution_of_the_window() -> None:
    train, drive = record(), record(n=700, seed=3, noise=0.05)
    settings = OnlineSettings(window=150, ridge=2.0)
    fitted = LeastSquares.fit([train], settings)
    row, s = 600, fitted.scaling
    k = np.arange(row - 150, row)
    phi = np.hstack([s.scale_x(drive.x[k]), s.scale_u(drive.u[k]), np.ones((150, 1))])
    y = (drive.x[k + 1] - drive.x[k]) / (s.x_scale * s.step_scale)
    theta = np.empty((3, 6))
    for row_of, of_constant in enumerate((2.0, 0.02, 0.02)):
        # The constants of v_y and yaw rate are nearly free.
        ridge = np.array([2.0] * 5 + [of_constant])
        right = phi.T @ y[:, row_of] + ridge * fitted.theta[row_of]
        theta[row_of] = np.linalg.solve(phi.T @ phi + np.diag(ridge), right)
    now = np.concatenate([s.scale_x(drive.x[row]), s.scale_u(drive.u[row]), [1.0]])
    expected = drive.x[row] + s.x_scale * s.step_scale * (theta @ now)
    # Which rows are asked for besides changes nothing.
    for rows in ([row], [3, 200, row], range(100, row + 1)):
        found = fitted.predict(drive, np.array(rows), 1)[-1, 0]
        np.testing.assert_allclose(found, expected, atol=1e-9)


def predictors() -> list[BenchPredictor]:
    train = record()
    car = load_vehicle("imdv")
    return [LeastSquares.fit([train]), LeastSquares.fit([train], OnlineSettings()), SevenDof(car)]


@pytest.mark.parametrize("predictor", predictors(), ids=lambda p: p.name)
def test_predictor_protocol(predictor: BenchPredictor) -> None:
    """Shapes, empty rows, and no use of future data but commands."""
    drive = record(seed=5, noise=0.02)
    rows = np.arange(20, 200, 9)
    predicted = predictor.predict(drive, rows, 30)
    assert predicted.shape == (rows.size, 30, 3)
    assert np.isfinite(predicted).all()
    assert predictor.predict(drive, rows[:0], 30).shape == (0, 30, 3)
    np.testing.assert_allclose(predictor.predict(drive, rows, 1), predicted[:, :1], atol=1e-12)
    last = int(rows[-1])
    x, a, u = drive.x.copy(), drive.a.copy(), drive.u.copy()
    x[last + 1 :] = 7.0
    a[last + 1 :] = 7.0
    u[last + 30 :] = 7.0
    unknown = np.full_like(drive.x_ref, np.nan)
    other = dataclasses.replace(drive, x=x, a=a, u=u, x_ref=unknown)
    np.testing.assert_array_equal(predictor.predict(other, rows, 30), predicted)
    # The command of the row itself acts on the step after it, and the last one not at all early.
    u = drive.u.copy()
    u[last + 10] += [400.0, 0.05]
    moved = predictor.predict(dataclasses.replace(drive, u=u), rows[-1:], 30)[0]
    before = predictor.predict(drive, rows[-1:], 30)[0]
    np.testing.assert_array_equal(moved[:10], before[:10])
    assert np.abs(moved[10] - before[10]).max() > 1e-4


@pytest.mark.parametrize("predictor", predictors(), ids=lambda p: p.name)
def test_nan_samples_affect_only_their_own_starts(predictor: BenchPredictor) -> None:
    drive = record(seed=6)
    x = drive.x.copy()
    x[40] = np.nan
    u = drive.u.copy()
    u[:10] = np.nan
    predicted = predictor.predict(
        dataclasses.replace(drive, x=x, u=u), np.array([20, 40, 100]), 20
    )
    assert np.isfinite(predicted[[0, 2]]).all()
    assert np.isnan(predicted[1]).any()


def test_actuator_states_restart_at_a_gap() -> None:
    drive = record(seed=7)
    u = np.zeros_like(drive.u)
    u[:50] = [2000.0, 0.1]
    whole = dataclasses.replace(drive, u=u)
    episode = (np.arange(len(drive)) >= 50).astype(np.int64)
    broken = dataclasses.replace(whole, episode=episode)
    model = SevenDof(load_vehicle("imdv"))
    rows = np.array([50])
    alone = model.predict(broken.rows(slice(50, None)), np.array([0]), 10)
    np.testing.assert_array_equal(model.predict(broken, rows, 10), alone)
    assert np.abs(model.predict(whole, rows, 10) - alone).max() > 1e-3


@pytest.mark.parametrize("predictor", predictors()[:2], ids=lambda p: p.name)
def test_least_squares_goes_on_where_readings_are_repeated(predictor: BenchPredictor) -> None:
    drive = record(seed=7, noise=0.02)
    flags, x = drive.flags.copy(), drive.x.copy()
    # The second start of a drive has no earlier reading of it.
    episode = (np.arange(len(drive)) >= 100).astype(np.int64)
    for row in (60, 61, 100):
        flags[row] |= int(Flag.ODOMETRY_STALE)
        x[row] = x[row - 1]
    repeated = dataclasses.replace(drive, x=x, flags=flags, episode=episode)
    from_last = predictor.predict(repeated, np.array([59]), 12)[0]
    rows = np.array([59, 60, 61, 62, 100])
    found = predictor.predict(repeated, rows, 10)
    np.testing.assert_allclose(found[0], from_last[:10], atol=1e-12)
    np.testing.assert_allclose(found[1], from_last[1:11], atol=1e-12)
    np.testing.assert_allclose(found[2], from_last[2:], atol=1e-12)
    at_once = [predictor.predict(repeated, rows[i : i + 1], 1)[0, 0] for i in range(5)]
    np.testing.assert_allclose(found[:, 0], at_once, atol=1e-12)
    x[[60, 61, 100]] += 1.0
    altered = predictor.predict(dataclasses.replace(repeated, x=x), rows, 10)
    np.testing.assert_array_equal(altered[:4], found[:4])
    assert np.abs(altered[4] - found[4]).max() > 0.1


def test_physics_goes_on_where_a_reading_is_repeated() -> None:
    drive = record(seed=7)
    flags = drive.flags.copy()
    flags[60] |= int(Flag.ODOMETRY_STALE)
    x = drive.x.copy()
    x[60] = x[59]
    repeated = dataclasses.replace(drive, x=x, flags=flags)
    model = SevenDof(load_vehicle("imdv"))
    from_last = model.predict(repeated, np.array([59]), 11)
    np.testing.assert_array_equal(model.predict(repeated, np.array([60]), 10)[0], from_last[0, 1:])
    # It is no part of the past either.
    later = model.predict(repeated, np.array([63]), 10)
    x[60] += 1.0
    altered = dataclasses.replace(repeated, x=x)
    np.testing.assert_array_equal(model.predict(altered, np.array([63]), 10), later)
