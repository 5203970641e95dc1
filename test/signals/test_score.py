# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Model-free baselines compared with closed forms, scorable rows, pooling of scores."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS, Flag, Record
from adk_ros.signals.score import (
    DIVERGED,
    HORIZON_STEPS,
    TICK_S,
    WHITE_NOISE_VARIANCE_ERROR,
    ErrorTable,
    best_naive,
    imu_integration,
    linear_extrapolation,
    naive_predictions,
    persistence,
    pool,
    reference_noise,
    scorable_rows,
    score,
    white_noise,
)


def record_of(x: FloatArray, a: FloatArray | None = None, **columns: Any) -> Record:
    n = len(x)
    plain: dict[str, Any] = {
        "stamp_ns": np.arange(n, dtype=np.int64) * TICK_NS,
        "u": np.zeros((n, 2)),
        "flags": np.zeros(n, dtype=np.int64),
        "x_ref": x.copy(),
        "episode": np.zeros(n, dtype=np.int64),
    }
    return Record(x=x, a=np.full((n, 2), np.nan) if a is None else a, **plain | columns)


def random_record(n: int = 200, seed: int = 0) -> Record:
    random = np.random.default_rng(seed)
    return record_of(random.normal(size=(n, 3)), random.normal(size=(n, 2)))


def still_record() -> Record:
    """Return a record that is zero where it is scored; a constant channel is not measured."""
    x = np.zeros((100, 3))
    x[-1] = 1.0
    return record_of(x)


def test_persistence() -> None:
    record, rows = random_record(), np.array([0, 7, 150])
    predicted = persistence(record, rows, 5)
    assert predicted.shape == (3, 5, 3)
    for step in range(5):
        np.testing.assert_array_equal(predicted[:, step], record.x[rows])


def test_linear_extrapolation_is_exact_on_a_straight_line() -> None:
    k = np.arange(100.0)[:, None]
    record = record_of(np.array([[1.0, -2.0, 0.1]]) + k * np.array([[0.3, 0.01, -0.02]]))
    rows = np.array([1, 50])
    predicted = linear_extrapolation(record, rows, 40)
    for step in range(1, 41):
        np.testing.assert_allclose(predicted[:, step - 1], record.x[rows + step], atol=1e-12)


def integrate(v: FloatArray, a: FloatArray, rate: float, seconds: float) -> FloatArray:
    """Integrate by Runge-Kutta with small steps."""

    def slope(now: FloatArray) -> FloatArray:
        return np.array([a[0] + rate * now[1], a[1] - rate * now[0]])

    count = 400
    h = seconds / count
    for _ in range(count):
        k1 = slope(v)
        k2 = slope(v + 0.5 * h * k1)
        k3 = slope(v + 0.5 * h * k2)
        v = v + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + slope(v + h * k3))
    return v


@settings(max_examples=40)
@given(
    st.floats(-40, 40), st.floats(-4, 4), st.floats(-9, 9), st.floats(-9, 9),
    st.one_of(st.floats(-3, 3), st.sampled_from([0.0, 1e-12, -1e-9, 1e-7, 3e-5])),
)  # fmt: skip
def test_imu_integration_is_exact_for_constant_force_and_yaw_rate(
    v_x: float, v_y: float, a_x: float, a_y: float, rate: float
) -> None:
    record = record_of(np.tile([v_x, v_y, rate], (3, 1)), np.tile([a_x, a_y], (3, 1)))
    predicted = imu_integration(record, np.array([1]), 80)[0]
    for steps in (1, 20, 80):
        exact = integrate(
            np.array([v_x, v_y]), np.array([a_x, a_y]), rate, steps * TICK_S
        )  # fmt: skip
        np.testing.assert_allclose(predicted[steps - 1], [*exact, rate], atol=1e-7)


def test_imu_integration_on_a_circle() -> None:
    """Centripetal force only: the velocity in the body frame is constant."""
    record = record_of(np.tile([20.0, 0.0, 0.5], (2, 1)), np.tile([0.0, 10.0], (2, 1)))
    predicted = imu_integration(record, np.array([0, 1]), 400)
    np.testing.assert_allclose(predicted, np.tile([20.0, 0.0, 0.5], (2, 400, 1)), atol=1e-9)


def test_naive_predictors_of_a_record_without_imu() -> None:
    record, rows = random_record(), np.arange(5, 100)
    assert list(naive_predictions(record, rows, 3)) == [
        "persistence", "straight line", "IMU integration"
    ]  # fmt: skip
    incomplete = replace(record, a=record.a.copy())
    incomplete.a[50, 1] = np.nan
    # An IMU that begins later, or has stopped: persistence stands for it.
    mixed = naive_predictions(incomplete, rows, 3)
    assert len(mixed) == 3
    without = ~np.isfinite(incomplete.a[rows]).all(axis=1)
    assert without.any()
    np.testing.assert_array_equal(mixed["IMU integration"][without], mixed["persistence"][without])
    assert list(naive_predictions(incomplete, rows[without], 3)) == [
        "persistence",
        "straight line",
    ]


def allowed(record: Record, row: int, history: int, ahead: int) -> bool:
    """Return whether a row is scorable, by the definition in the docstring."""
    if row - history < 0 or row + ahead >= len(record):
        return False
    past = slice(row - history, row + 1)
    future = slice(row, row + ahead + 1)
    return bool(
        len(set(record.episode[row - history : row + ahead + 1])) == 1
        and record.learnable[past].all()
        and np.isfinite(record.x[past]).all()
        and np.isfinite(record.x_ref[future]).all()
        and np.isfinite(record.u[future]).all()
    )


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.integers(0, 6), st.integers(1, 12), st.integers(0, 90))
def test_starts(seed: int, history: int, ahead: int, n: int) -> None:
    random = np.random.default_rng(seed)
    record = random_record(n, seed)
    record = replace(record, episode=np.cumsum(random.random(n) < 0.04))
    for column in (record.x, record.x_ref, record.u):
        column[random.random(n) < 0.03] = np.nan
    kinds = [int(Flag.COASTING), int(Flag.FROZEN), int(Flag.COMMAND_STALE), int(Flag.NO_IMU)]
    flagged = random.random(n) < 0.05
    record.flags[flagged] = random.choice(kinds, int(flagged.sum()))
    expected = [row for row in range(n) if allowed(record, row, history, ahead)]
    assert scorable_rows(record, history, ahead).tolist() == expected
    assert scorable_rows(record, history, ahead, stride=3).tolist() == expected[::3]


def test_score_of_known_errors() -> None:
    record = still_record()
    rows = np.array([0, 10])
    predicted = np.zeros((2, 80, 3))
    predicted[0, 0], predicted[1, 0] = (3.0, 0.0, 1.0), (-4.0, 0.0, -1.0)
    predicted[:, 79, 1] = 2.0
    result = score(record, rows, predicted, (1, 80))
    assert result.steps == (1, 80)
    assert result.count == 2
    assert result.diverged == 0
    np.testing.assert_allclose(result.rmse, [[12.5**0.5, 0.0, 1.0], [0.0, 2.0, 0.0]])
    np.testing.assert_allclose(result.worst, [[4.0, 0.0, 1.0], [0.0, 2.0, 0.0]])


def test_score_uses_the_measurement_at_the_predicted_step() -> None:
    k = np.arange(200.0)
    record = record_of(np.stack([k, k**2, np.sin(k)], axis=1))
    rows = np.arange(3, 100)
    exact = record.x_ref[rows[:, None] + np.arange(1, 81)]
    assert score(record, rows, exact).rmse.max() == 0.0
    assert score(record, rows, exact).steps == HORIZON_STEPS
    late = record.x_ref[rows[:, None] + np.arange(0, 80)]
    np.testing.assert_allclose(score(record, rows, late).rmse[:, 0], 1.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e5, -1e300])
def test_diverged_predictions_are_scored(bad: float) -> None:
    record = still_record()
    predicted = np.zeros((4, 80, 3))
    predicted[0, 79, 0] = predicted[0, 79, 1] = predicted[2, 9, 2] = bad
    predicted[3, 5] = bad
    result = score(record, np.arange(4), predicted)
    assert result.diverged == 2
    assert result.worst.max() == DIVERGED
    np.testing.assert_allclose(result.rmse[4], [DIVERGED / 2, DIVERGED / 2, 0.0])
    assert np.isfinite(result.rmse).all()


@settings(max_examples=30)
@given(st.integers(0, 999), st.lists(st.integers(0, 40), min_size=1, max_size=5))
def test_pool_is_the_score_over_all_starts(seed: int, counts: list[int]) -> None:
    record, random = random_record(300, seed), np.random.default_rng(seed)
    rows = np.arange(sum(counts))
    predicted = random.normal(size=(len(rows), 80, 3))
    predicted[random.random(len(rows)) < 0.1] = np.inf
    edges = np.cumsum([0, *counts])
    if not sum(counts):
        with pytest.raises(ValueError, match="no table has a scored start"):
            pool([])
        return
    parts = [
        score(record, rows[a:b], predicted[a:b])
        for a, b in pairwise(edges) if b > a
    ]  # fmt: skip
    empty = ErrorTable(HORIZON_STEPS, np.full((5, 3), np.nan), np.full((5, 3), np.nan), 0, 0)
    pooled, joint = pool([empty, *parts]), score(record, rows, predicted)
    np.testing.assert_allclose(pooled.rmse, joint.rmse)
    np.testing.assert_allclose(pooled.worst, joint.worst)
    assert (pooled.count, pooled.diverged) == (joint.count, joint.diverged)


def test_a_constant_channel_is_not_scored() -> None:
    record = random_record()
    x = record.x.copy()
    x[:, 1] = 0.0
    dead = replace(record, x=x, x_ref=x.copy())
    rows = np.arange(10, 40)
    assert record.measured.all()
    assert dead.measured.tolist() == [True, False, True]
    table = score(dead, rows, persistence(dead, rows, 80))
    assert np.isnan(table.rmse[:, 1]).all()
    assert np.isnan(table.worst[:, 1]).all()
    assert np.isfinite(table.rmse[:, [0, 2]]).all()
    assert table.diverged == 0
    # With a recording that measures it, the pool is that of the other.
    other = score(record, rows, persistence(record, rows, 80))
    np.testing.assert_allclose(pool([table, other]).rmse[:, 1], other.rmse[:, 1])
    assert np.isnan(pool([table, table]).rmse[:, 1]).all()
    assert np.isnan(best_naive({"a": table})[:, 1]).all()


def test_pool_of_empty_tables() -> None:
    empty = ErrorTable((1,), np.full((1, 3), np.nan), np.full((1, 3), np.nan), 0, 0)
    with pytest.raises(ValueError, match="no table has a scored start"):
        pool([empty])


def test_reference_noise_recovers_a_known_standard_deviation() -> None:
    random = np.random.default_rng(0)
    t = np.arange(8000)[:, None] * TICK_S
    sigma = np.array([0.02, 0.003, 0.001])
    smooth = np.sin(t * [0.5, 1.0, 2.0]) * [5.0, 0.3, 0.2]
    record = record_of(smooth + random.normal(size=(8000, 3)) * sigma)
    np.testing.assert_allclose(reference_noise(record), sigma, rtol=0.08)
    # A few jerks and gaps do not count as noise.
    record.x_ref[::400] += 3.0
    record.x_ref[1000:1100] = np.nan
    np.testing.assert_allclose(reference_noise(record), sigma, rtol=0.1)


def test_the_variance_of_the_noise_is_as_uncertain_as_stated() -> None:
    samples, repetitions = 4000, 2000
    random = np.random.default_rng(0)
    variances = white_noise(random.standard_normal((samples, repetitions))) ** 2
    # 2000 repetitions know a variance to 3 %.
    assert samples * variances.var() == pytest.approx(WHITE_NOISE_VARIANCE_ERROR, rel=0.1)


def test_reference_noise_of_too_few_samples() -> None:
    assert np.isnan(reference_noise(random_record(12))).all()
    assert np.isnan(reference_noise(record_of(np.full((500, 3), np.nan)))).all()


def test_best_naive_per_step_and_channel() -> None:
    one = ErrorTable((1,), np.array([[1.0, 5.0, 3.0]]), np.zeros((1, 3)), 4, 0)
    two = ErrorTable((1,), np.array([[2.0, 4.0, 3.5]]), np.zeros((1, 3)), 4, 0)
    assert best_naive({"one": one, "two": two}).tolist() == [[1.0, 4.0, 3.0]]
