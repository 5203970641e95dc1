# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Horizons as they were published, and what they say of the next one's errors."""

import math

import numpy as np
import pytest
from helpers.model import Array, inputs, make_model, paper_model, sample

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.prediction import Prediction
from adk_ros.model.predictor import Predictor
from adk_ros.model.uncertainty.conformal import FORGETTING, GAIN, ROLLOUT_STRIDE
from adk_ros.model.uncertainty.fallback import integrate_imu
from adk_ros.numerics.constants import QUANTILE_90
from adk_ros.signals.channels import Flag

HELD = np.arange(1.0, 81.0)[:, None, None] * np.array(
    [[0.02, 0.001, 0.0], [0.001, 0.006, 0.0], [0.0, 0.0, 0.002]]
)
UNLEARNABLE = int(Flag.ODOMETRY_STALE)


def model(**changes: object) -> KoopmanModel:
    return make_model(**{"held_input_covariance": HELD} | changes)


def states(n: int, seed: int = 2) -> Array:
    random = np.random.default_rng(seed)
    walk = np.cumsum(random.standard_t(3, (n, 3)) * [0.02, 0.006, 0.004], axis=0)
    return np.asarray(np.array([15.0, 0.0, 0.05]) + walk)


def drive(car: Predictor, n: int, flags: dict[int, int] | None = None) -> list[Prediction | None]:
    x, u = states(n), inputs(n)
    return [car.step(sample(k, x[k], u[k], (flags or {}).get(k, 0))) for k in range(n)]


def recomputed(made: list[Prediction | None], flags: dict[int, int], steps: int) -> Array:
    """The covariance after all of `made`, from the predictions alone, in plain numpy."""
    x = states(len(made))
    start = HELD[np.minimum(np.arange(steps), 79)]
    covariance, factor, count = start.copy(), np.zeros((steps, 3)), np.full(steps, 5.0)
    kept: list[tuple[int, Array, Array]] = []
    number = 0
    for k, prediction in enumerate(made):
        if prediction is None:
            continue
        for first, horizon, variance in kept:
            h = k - first - 1
            if h >= steps or flags.get(k, 0):
                continue
            error = x[k] - horizon[h]
            missed = np.abs(error) > QUANTILE_90 * np.sqrt(variance[h])
            factor[h] = np.clip(factor[h] + GAIN * (missed - 0.1), -math.log(4), math.log(4))
            count[h] = FORGETTING * count[h] + 1.0
            covariance[h] += (np.outer(error, error) - covariance[h]) / count[h]
        if not flags.get(k, 0) & int(Flag.COASTING | Flag.ODOMETRY_STALE):
            number += 1
            if number % ROLLOUT_STRIDE == 0:
                s = np.exp(factor)
                variance = np.diagonal(covariance, axis1=1, axis2=2) * s**2
                kept.append((k, prediction.horizon, variance.copy()))
    return np.asarray(covariance * np.exp(factor)[:, :, None] * np.exp(factor)[:, None, :])


@pytest.mark.parametrize("steps", [1, 40, 80, 123, 400])
@pytest.mark.usefixtures("unshrunk")
def test_statistics_equal_those_of_the_published_horizons(steps: int) -> None:
    flags = dict.fromkeys(range(300, 310), UNLEARNABLE)
    flags |= dict.fromkeys(range(500, 520), int(Flag.COASTING))
    car = Predictor(model(), horizon_steps=steps)
    made = drive(car, 900, flags)
    wanted = recomputed(made, flags, steps)
    np.testing.assert_allclose(car.held_input_covariance, wanted, rtol=1e-7, atol=1e-14)
    last = made[-1]
    assert last is not None
    np.testing.assert_array_equal(last.horizon_covariance, car.held_input_covariance)
    before = np.diagonal(HELD[np.minimum(np.arange(steps), 79)], axis1=1, axis2=2)
    assert np.mean(np.diagonal(wanted, axis1=1, axis2=2) != before) == 1.0


@pytest.mark.parametrize("steps", [0, 1, 40, 80, 400])
def test_initial_covariance_is_the_models_last_row_repeated(steps: int) -> None:
    car = Predictor(model(), horizon_steps=steps)
    rows = np.minimum(np.arange(steps), 79)
    np.testing.assert_array_equal(car.held_input_covariance, HELD[rows].reshape(steps, 3, 3))
    for prediction in drive(car, 60):
        if prediction is not None:
            assert prediction.horizon_covariance.shape == (steps, 3, 3)


def test_initial_covariance_falls_back_to_other_tables() -> None:
    known = make_model()
    np.testing.assert_array_equal(Predictor(known).held_input_covariance, known.horizon_covariance)
    bare = paper_model()
    car = Predictor(bare, horizon_steps=20)
    usual = np.square(bare.scaling.x_scale * bare.scaling.step_scale)
    np.testing.assert_allclose(car.held_input_covariance[19], 20.0 * np.diag(usual))
    # Rolled out in the lifted space there are no trials, but what is published can be compared.
    drive(car, 300)
    assert car.rollout_monitor is None
    assert (np.diagonal(car.held_input_covariance[19]) != 20.0 * usual).all()


def test_published_covariances_are_symmetric_and_positive() -> None:
    for prediction in drive(Predictor(model()), 900):
        if prediction is not None:
            table = prediction.horizon_covariance
            assert np.isfinite(table).all()
            np.testing.assert_array_equal(table, table.transpose(0, 2, 1))
            least, most = np.linalg.eigvalsh(table)[:, [0, -1]].T
            assert (least >= -1e-12 * most).all()


def test_coasting_shifts_the_horizon_covariance() -> None:
    flags = dict.fromkeys(range(500, 503), int(Flag.COASTING))
    car = Predictor(model())
    made = drive(car, 503, flags)
    first, last = made[499], made[502]
    assert first is not None
    assert last is not None
    rows = np.minimum(np.arange(80) + 3, 79)
    np.testing.assert_array_equal(last.horizon_covariance, first.horizon_covariance[rows])


def test_horizons_are_shrunk_and_weighted_by_what_happened() -> None:
    """In plain numpy, from horizons as the model predicts them."""
    x, u = states(700), inputs(700)
    rate = np.gradient(x, 0.025, axis=0)
    # Forces that explain half of the motion: IMU integration is worth something.
    a = 0.5 * np.column_stack([rate[:, 0] - x[:, 2] * x[:, 1], rate[:, 1] + x[:, 2] * x[:, 0]])
    samples = [
        sample(k, x[k], u[k])._replace(a=(float(a[k, 0]), float(a[k, 1]))) for k in range(700)
    ]
    shrunk = Predictor(model())
    raw = Predictor(model())
    raw._published._stored.shrinks[0] = 0
    sums, k_of = np.zeros((4, 80, 3)), np.ones((80, 3))
    of_imu, w_of = np.zeros((4, 80, 3)), np.zeros((80, 3))
    kept: list[tuple[int, Array, Array, Array]] = []
    number = 0
    for k, item in enumerate(samples):
        made, said = shrunk.step(item), raw.step(item)
        if made is None or said is None:
            continue
        for first, base, horizon, naive in kept:
            h = k - first - 1
            if not 0 < h < 80:
                continue
            m, y = horizon[h] - base, np.array(item.x) - base
            sums[:, h] = 0.985 * sums[:, h] + [m * y, m * m, np.ones(3), y * y]
            before = k_of[h].copy()
            my, mm, n, yy = sums[:, h]
            slope = my / mm
            residual = np.maximum(yy - slope * my, 0.0) / n
            certain = np.maximum(1.0 - residual / ((1.0 - slope) ** 2 * mm), 0.0)
            k_of[h] = np.clip(1.0 - n / (n + 3.0) * certain * (1.0 - slope), 0.0, 1.0)
            # What is learned from a horizon is of those that it was learned from before.
            e = y - before * m
            d = naive[h] - base - before * m
            of_imu[:, h] = 0.985 * of_imu[:, h] + [d * e, d * d, np.ones(3), e * e]
            de, dd, n, ee = of_imu[:, h]
            slope = de / np.maximum(dd, 1e-12)
            residual = np.maximum(ee - slope * de, 0.0) / n
            certain = np.maximum(1.0 - residual / np.maximum(slope**2 * dd, 1e-12), 0.0)
            w_of[h] = np.clip(n / (n + 3.0) * certain * slope, 0.0, 1.0)
        base = shrunk.filtered_state
        wanted = base + k_of * (said.horizon - base)
        naive = np.empty((80, 3))
        integrate_imu(np.array([item.x, np.zeros(3), [*item.a, np.nan], item.x]), naive)
        wanted += w_of * (naive - wanted)
        wanted[0] = said.horizon[0]
        np.testing.assert_allclose(made.horizon, wanted, rtol=1e-9, atol=1e-9)
        # The command of the first step is known.
        np.testing.assert_array_equal(made.x, said.x)
        number += 1
        if number % ROLLOUT_STRIDE == 0:
            kept.append((k, base, said.horizon, naive))
    assert k_of.min() < 0.5
    assert w_of[:, :2].max() > 0.1
    np.testing.assert_allclose(shrunk._published.shrinkage, k_of, atol=1e-9)
    shrunk.reset()
    assert (shrunk._published.shrinkage == 1.0).all()


def test_a_driver_who_holds_the_speed_makes_no_change_the_prediction() -> None:
    """The model says that a torque accelerates; against wind, the speed stays as it is."""
    n = 1500
    x = np.tile([15.0, 0.0, 0.0], (n, 1)) + np.random.default_rng(0).normal(0, 0.005, (n, 3))
    u = np.column_stack([400.0 + 300.0 * np.sin(0.05 * np.arange(n)), np.zeros(n)])
    errors = {}
    for shrinks in (0, 1):
        car = Predictor(model(online=OnlineSettings("constant")))
        car._published._stored.shrinks[0] = shrinks
        made = [car.step(sample(k, x[k], u[k])) for k in range(n)]
        last = [m.horizon[79] - x[k] for k, m in enumerate(made) if m is not None and k > 900]
        errors[shrinks] = np.sqrt(np.mean(np.square(last), axis=0))
    assert errors[1][0] < 0.3 * errors[0][0]


def test_losing_the_state_ends_comparisons_and_reset_forgets() -> None:
    car = Predictor(model(), max_coast_steps=5)
    flags = dict.fromkeys(range(400, 500), int(Flag.COASTING))
    made = drive(car, 504, flags)
    assert made[450] is None
    before = made[399]
    after = made[-1]
    assert before is not None
    assert after is not None
    # Nothing published before the gap was compared behind it.
    np.testing.assert_array_equal(after.horizon_covariance, before.horizon_covariance)
    car.reset()
    np.testing.assert_array_equal(car.held_input_covariance, HELD)
    drive(car, 300)
    assert (car.held_input_covariance != HELD).any()
    car.step(sample(2000, [15.0, 0.0, 0.0], [0.0, 0.0]))
    np.testing.assert_array_equal(car.held_input_covariance, HELD)


def test_returned_covariances_are_copies() -> None:
    car = Predictor(model())
    made = drive(car, 100)[-1]
    assert made is not None
    made.horizon_covariance[:] = math.nan
    car.held_input_covariance[:] = math.nan
    assert np.isfinite(car.held_input_covariance).all()


def test_published_intervals_cover_ninety_percent() -> None:
    """Of a car that takes steps with heavy tails, which no model could know."""
    made, x = drive(Predictor(model()), 8000), states(8000)
    for h in (0, 9, 39, 79):
        held = [
            np.abs(x[k + 1 + h] - p.horizon[h])
            <= QUANTILE_90 * np.sqrt(np.diagonal(p.horizon_covariance[h]))
            for k, p in enumerate(made[: -1 - h])
            if p is not None
        ]
        assert (np.abs(np.mean(held, axis=0) - 0.9) < 0.025).all(), h
