# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Naive predictors that take over: what they predict, how they are mixed in, and what stays."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from helpers.model import Array, inputs, make_model, sample
from helpers.signals import drive, in_order

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.evaluation import rollout_record, sample_at
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.prediction import Prediction
from adk_ros.model.predictor import Predictor
from adk_ros.model.tick_steps import CompiledTick, FusedTick
from adk_ros.model.uncertainty.fallback import Fallback, summary
from adk_ros.numerics.constants import QUANTILE_90
from adk_ros.signals.channels import Flag, Record, Sample
from adk_ros.signals.record import build_record
from adk_ros.signals.score import NAIVE_PREDICTORS, naive_predictions

CHANGE = np.outer(np.arange(1.0, 81.0), [1e-2, 1e-3, 1e-3])
SETTINGS = OnlineSettings("windowed", window=50, ridge=1.0)


def weights(seed: int = 0) -> Array:
    """Random weights, zero at some steps."""
    random = np.random.default_rng(seed)
    drawn: Array = random.uniform(0.0, 1.0 / 3.0, (2, 3, 80, 3))
    drawn[:, :, 30:40] = 0.0
    return drawn


def only(predictor: int) -> Array:
    alone = np.zeros((2, 3, 80, 3))
    alone[:, predictor] = 1.0
    return alone


def model(given: Array | None = None, **changes: object) -> KoopmanModel:
    changes = {"mean_square_change": CHANGE, "online": SETTINGS} | changes
    if given is not None:
        changes["fallback"] = Fallback(given)
    return make_model(**changes)


@pytest.fixture(scope="module")
def record() -> Record:
    return build_record(in_order(drive(15.0, noise=1e-3)), "slalom")


def along(of: KoopmanModel, record: Record) -> tuple[Predictor, list[Prediction | None]]:
    car = Predictor(of)
    return car, [car.step(sample_at(record, row)) for row in range(len(record))]


@pytest.mark.parametrize("predictor", range(3))
@pytest.mark.parametrize("compiled", [True, False])
def test_with_weight_one_the_naive_predictor_is_alone(
    record: Record, predictor: int, compiled: bool, unshrunk: None
) -> None:
    rolled = rollout_record(model(only(predictor), compiled=compiled), record, stride=50)
    wanted = naive_predictions(record, rolled.rows, 80)[NAIVE_PREDICTORS[predictor]]
    for predicted in (rolled.predicted, rolled.held_input_predictions):
        np.testing.assert_allclose(predicted, wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("compiled", [True, False])
def test_predictions_are_mixed_by_the_weights(
    record: Record, compiled: bool, unshrunk: None
) -> None:
    plain = rollout_record(model(compiled=compiled), record, stride=50)
    mixed = rollout_record(model(weights(), compiled=compiled), record, stride=50)
    naive = naive_predictions(record, plain.rows, 80)
    names = ("predicted", "held_input_predictions")
    for commands, name in enumerate(names):
        wanted = alone = getattr(plain, name)
        for number, states in enumerate(naive.values()):
            wanted = wanted + weights()[commands, number] * (states - alone)
        np.testing.assert_allclose(getattr(mixed, name), wanted, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(getattr(mixed, name)[:, 30:40], alone[:, 30:40])


def test_the_model_itself_goes_on_as_without(record: Record) -> None:
    gains = replace(make_model().observer_gains, observer_gain=np.full(3, 0.4))
    (one, _), (other, _) = (
        along(model(given, observer_gains=gains), record) for given in (None, weights())
    )
    for name in ("filtered_state", "disturbance"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(one.online.theta, other.online.theta)
    assert one.rollout_monitor is not None
    assert other.rollout_monitor is not None
    np.testing.assert_array_equal(one.rollout_monitor.shrinkage, other.rollout_monitor.shrinkage)


@pytest.mark.parametrize("compiled", [True, False])
def test_weights_of_zero_change_no_bit(record: Record, compiled: bool) -> None:
    # Not compiled, a tick takes 12 ms.
    record = record if compiled else record.rows(slice(150))
    results = [
        along(model(given, compiled=compiled), record) for given in (None, np.zeros((2, 3, 80, 3)))
    ]
    (one, made), (other, again) = results
    for first, second in zip(made, again, strict=True):
        assert (first is None) == (second is None)
        if first is not None and second is not None:
            for name in ("x", "covariance", "horizon", "horizon_covariance", "innovation"):
                np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_array_equal(one.horizon_covariance, other.horizon_covariance)
    ahead = record.u[:80]
    np.testing.assert_array_equal(one.rollout(ahead), other.rollout(ahead))


def test_the_fused_tick_equals_the_compiled_one(record: Record) -> None:
    fused, compiled = Predictor(model(weights())), Predictor(model(weights()))
    assert isinstance(fused._steps, FusedTick)
    assert compiled.rollout_monitor is not None
    compiled._steps = CompiledTick(
        compiled._steps._kept,  # type: ignore[attr-defined]
        compiled.rollout_monitor,
    )
    for row in range(len(record)):
        one, other = (car.step(sample_at(record, row)) for car in (fused, compiled))
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            np.testing.assert_allclose(one.horizon, other.horizon, atol=1e-12)
            np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-9)
    np.testing.assert_allclose(fused.horizon_covariance, compiled.horizon_covariance, rtol=1e-9)


def test_evaluation_equals_the_predictor_on_the_vehicle(record: Record) -> None:
    of = model(weights())
    rolled = rollout_record(of, record, stride=40)
    car = Predictor(of)
    for row in range(int(rolled.rows[-1]) + 1):
        made = car.step(sample_at(record, row))
        for k in np.flatnonzero(rolled.rows == row):
            assert made is not None
            np.testing.assert_array_equal(rolled.held_input_predictions[k], made.horizon)
            known = car.rollout(record.u[row : row + 80])
            np.testing.assert_array_equal(rolled.predicted[k], known)


def test_what_a_naive_predictor_lacks_leaves_the_model_alone(record: Record) -> None:
    """No IMU: the integration is unknown. No earlier sample: so is the change per tick."""
    without = replace(record, a=np.full_like(record.a, np.nan))
    plain = rollout_record(model(), without, stride=50)
    mixed = rollout_record(model(only(2)), without, stride=50)
    np.testing.assert_array_equal(mixed.predicted[:, :, :2], plain.predicted[:, :, :2])
    # The yaw rate is held, which needs no accelerometer.
    states = np.repeat(record.x[mixed.rows, None, 2:], 80, axis=1)
    np.testing.assert_allclose(mixed.predicted[:, :, 2:], states, atol=1e-12)
    first = Sample(0, (15.0, 0.0, 0.0), (100.0, 0.0), (0.0, 0.0), 0)
    for given in (None, only(1)):
        car = Predictor(model(given, history=0))
        made = car.step(first)
        assert made is not None
        if given is None:
            alone = made.horizon
        else:
            np.testing.assert_array_equal(made.horizon, alone)


@pytest.mark.parametrize("flag", [Flag.COASTING, Flag.LEVEL_CHANGE, Flag.ODOMETRY_STALE])
def test_defective_samples_are_predicted_from(record: Record, flag: Flag) -> None:
    car = Predictor(model(weights()))
    for row in range(300):
        item = sample_at(record, row)
        flags = item.flags | (int(flag) if 200 <= row < 210 else 0)
        made = car.step(item._replace(flags=flags))
        if row > 10:
            assert made is not None
            assert made.is_finite()
            assert np.abs(made.horizon[0] - item.x).max() < 2.0


def coasted(of: KoopmanModel, record: Record, ticks: int) -> list[Prediction]:
    """Predictions while odometry is lost for some ticks after row 200."""
    car = Predictor(of)
    made = []
    for row in range(201 + ticks):
        item = sample_at(record, row)
        if row > 200:
            item = item._replace(x=(np.nan,) * 3, flags=item.flags | int(Flag.COASTING))
        prediction = car.step(item)
        if row > 200:
            assert prediction is not None
            made.append(prediction)
    return made


def test_naive_predictors_start_from_the_last_measurement_while_coasting(
    record: Record, unshrunk: None
) -> None:
    """As many steps ahead as have passed, and not from what they have said themselves."""
    naive = {name: x[0] for name, x in naive_predictions(record, np.array([200]), 120).items()}
    for predictor, name in enumerate(NAIVE_PREDICTORS):
        made = coasted(model(only(predictor)), record, 10)
        for passed, prediction in enumerate(made, 1):
            if name == NAIVE_PREDICTORS[2]:
                continue
            wanted = naive[name][passed : passed + 80]
            np.testing.assert_allclose(prediction.horizon, wanted, rtol=1e-9, atol=1e-9)
    # The IMU goes on measuring.
    state = record.x[200]
    for row, prediction in enumerate(coasted(model(only(2)), record, 10), 200):
        at = replace(record, x=np.tile(state, (len(record), 1)))
        state = naive_predictions(at, np.array([row]), 1)[NAIVE_PREDICTORS[2]][0, 0]
        at = replace(record, x=np.tile(state, (len(record), 1)))
        wanted = naive_predictions(at, np.array([row + 1]), 80)[NAIVE_PREDICTORS[2]][0]
        np.testing.assert_allclose(prediction.horizon, wanted, rtol=1e-9, atol=1e-9)


def test_while_coasting_the_model_goes_on_alone(record: Record, unshrunk: None) -> None:
    """A weight at the first step is none at later ones: persistence for a second is far worse."""
    first = np.zeros((2, 3, 80, 3))
    first[:, 0, 0] = 1.0
    alone, mixed = (coasted(model(given), record, 20) for given in (None, first))
    for one, other in zip(alone, mixed, strict=True):
        np.testing.assert_allclose(other.x, one.x, rtol=1e-9, atol=1e-9)


def test_while_coasting_weights_count_by_the_share_of_steps(
    record: Record, unshrunk: None
) -> None:
    """Of the ticks since the measurement, and of the steps for which the command is held."""
    given = np.zeros((2, 3, 80, 3))
    given[0, 0, :, 0] = np.linspace(0.0, 0.5, 80)
    given[1, 0, :, 0] = np.linspace(0.0, 1.0, 80)
    alone, mixed = (coasted(model(of), record, 20) for of in (None, given))
    steps = np.arange(80)
    for passed, (one, other) in enumerate(zip(alone, mixed, strict=True), 1):
        known, held = given[:, 0, np.minimum(steps + passed, 79), 0]
        weight = known + steps / (steps + passed) * (held - known)
        wanted = one.horizon[:, 0] + weight * (record.x[200, 0] - one.horizon[:, 0])
        np.testing.assert_allclose(other.horizon[:, 0], wanted, rtol=1e-9, atol=1e-9)


def test_the_present_state_is_the_published_one(record: Record, unshrunk: None) -> None:
    """A reading is expected on the line from it to the next: both are of one prediction."""
    given = np.zeros((2, 3, 80, 3))
    given[0, 0, 1:, 0] = 1.0
    car = Predictor(model(given))
    for row in range(210):
        item = sample_at(record, row)
        if row > 200:
            item = item._replace(x=(np.nan,) * 3, flags=item.flags | int(Flag.COASTING))
        before = car._predicted
        made = car.step(item)
    assert made is not None
    assert before is not None
    np.testing.assert_array_equal(car.present_state, before)
    assert car.present_state[0] == made.x[0] == record.x[200, 0]
    assert car.filtered_state[0] != record.x[200, 0]


def test_a_learned_weight_of_the_imu_goes_with_the_imu(record: Record) -> None:
    """What it was is the model's or a naive predictor's, as trained."""
    given = np.zeros((2, 3, 80, 3))
    given[0, 0, :, 0] = 1.0
    car = Predictor(model(given))
    fallback = car._memory.fallback
    car.step(sample_at(record, 0))
    for row in range(1, 50):
        car.step(sample_at(record, row))
    fallback.weights[0, 0, :, 0], fallback.weights[0, 2, :, 0] = 0.2, 0.8
    learned = car.rollout(record.u[49:59])[:, 0]
    assert np.ptp(learned) > 1e-6
    # Its last reading, or what was integrated from readings of which one is missing.
    for row in (2, 3):
        before = fallback.start[row].copy()
        fallback.start[row] = np.nan
        np.testing.assert_allclose(car.rollout(record.u[49:59])[:, 0], record.x[49, 0], atol=1e-9)
        fallback.start[row] = before


def walk(n: int, seed: int = 4) -> Array:
    random = np.random.default_rng(seed)
    steps = np.cumsum(random.standard_t(4, (n, 3)) * [0.02, 0.006, 0.004], axis=0)
    return np.asarray(np.array([15.0, 0.0, 0.05]) + 0.2 * steps)


def covered(errors: Sequence[Array], tables: Sequence[Array]) -> Array:
    deviations = np.sqrt(np.diagonal(np.array(tables), axis1=2, axis2=3))
    return np.asarray((np.abs(np.array(errors)) < QUANTILE_90 * deviations).mean(axis=0))


def coverage(given: Array | None) -> Array:
    """Shares of covered errors (2, 3), with commands known and held, on a random walk."""
    n = 6000
    x, u = walk(n), inputs(n)
    car = Predictor(model(given, held_input_covariance=np.tile(np.eye(3), (80, 1, 1))))
    errors: tuple[list[Array], ...] = ([], [])
    tables: tuple[list[Array], ...] = ([], [])
    for k in range(n - 80):
        made = car.step(sample(k, x[k], u[k]))
        if k > 1500 and k % 10 == 0:
            assert made is not None
            states = x[k + 1 : k + 81]
            errors[0].append(states - car.rollout(u[k : k + 80]))
            tables[0].append(car.horizon_covariance.copy())
            errors[1].append(states - made.horizon)
            tables[1].append(made.horizon_covariance)
    shares = [covered(*pair).mean(axis=0) for pair in zip(errors, tables, strict=True)]
    return np.array(shares)


def test_covariances_cover_what_is_predicted() -> None:
    """Persistence takes over in part: the covariances are those of what is predicted."""
    given = np.zeros((2, 3, 80, 3))
    given[:, 0] = [1.0, 0.5, 0.0]
    mixed, alone = coverage(given), coverage(None)
    assert (np.abs(mixed - 0.9) < 0.05).all(), mixed
    np.testing.assert_array_equal(mixed[:, 2], alone[:, 2])


def test_the_innovation_is_of_the_published_prediction(record: Record) -> None:
    _, made = along(model(weights()), record)
    before = None
    for row, prediction in enumerate(made):
        if prediction is not None and before is not None:
            wanted = record.x[row] - before.x
            np.testing.assert_allclose(prediction.innovation, wanted, atol=1e-12)
        before = prediction


def test_takeovers_state_the_weights_at_the_scored_horizons() -> None:
    given = np.zeros((2, 3, 80, 3))
    given[0, 2, :20, 0] = np.linspace(1.0, 0.05, 20)
    given[1, 0, 79, 2] = 0.5
    fallback = Fallback(given)
    assert [item.text for item in fallback.takeovers()] == [
        "v_x, commands known: IMU integration, weight 1.00 at 0.025 s, 0.55 at 0.25 s, "
        "0.05 at 0.5 s",
        "yaw_rate, commands held: persistence, weight 0.50 at 2 s",
    ]
    assert summary(fallback.takeovers()) == (
        "v_x IMU integration 0.025 to 0.5 s, yaw_rate persistence 2 s"
    )
    assert Fallback.none().takeovers() == []
    assert summary([]) == ""
