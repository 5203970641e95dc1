# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which naive predictors take over, with which weights: on constructed errors, and on drives."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.train import made_record, record, small

from adk_ros.model import artefact
from adk_ros.model.evaluation import Rollouts, rollout_record
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.uncertainty.fallback import HELD, KNOWN, Fallback
from adk_ros.signals.channels import Record
from adk_ros.signals.score import HORIZON_STEPS, NAIVE_PREDICTORS, naive_predictions
from adk_ros.train.dataset import TEST, TRAIN, VALIDATION, Split, split_records
from adk_ros.train.fallback_weights import _ratio, fallback_of, find_fallback
from adk_ros.train.held_out import score_held_out
from adk_ros.train.hyperparameters import with_fallback

PERSISTENCE = NAIVE_PREDICTORS.index("persistence")
AT = np.array(HORIZON_STEPS) - 1


def wandering(seed: int = 0, n: int = 2400) -> Record:
    """A random walk: persistence is the best predictor of it."""
    random = np.random.default_rng(seed)
    steps = random.normal(0.0, 0.02, (n, 3))
    return made_record(np.cumsum(steps, axis=0) + np.array([15.0, 0.0, 0.0]))


def rolled(of: Record, quality: float, seed: int = 9) -> Rollouts:
    """A model that predicts `quality` of the change, and errs by a tenth of it."""
    random = np.random.default_rng(seed)
    rows = np.arange(10, len(of) - 80, 8)
    start = of.x[rows, None]
    change = of.x_ref[rows[:, None] + np.arange(1, 81)] - start
    predicted = start + quality * change
    predicted += 0.1 * np.abs(change) * random.normal(size=predicted.shape)
    return Rollouts(of, rows, predicted, predicted.copy())


def test_a_better_model_stays_alone() -> None:
    fallback = fallback_of([rolled(wandering(1), 0.8)], [rolled(wandering(2), 0.8)])
    assert not fallback.is_active
    assert fallback.weights.shape == (2, 3, 0, 3)


def test_a_model_that_predicts_the_opposite_is_replaced() -> None:
    """Its error m = 2 n, so that m + w (n - m) is zero for w = 2: limited to 1."""
    fallback = fallback_of([rolled(wandering(1), -1.0)], [rolled(wandering(2), -1.0)])
    np.testing.assert_array_equal(fallback.weights[:, PERSISTENCE], 1.0)
    np.testing.assert_array_equal(np.delete(fallback.weights, PERSISTENCE, axis=1), 0.0)


def independent(of: Record, ratio: float) -> Rollouts:
    """A model whose error is independent of that of persistence and `ratio` as large."""
    random = np.random.default_rng(5)
    rows = np.arange(10, len(of) - 80, 8)
    future = of.x_ref[rows[:, None] + np.arange(1, 81)]
    size = ratio * np.sqrt(np.mean((future - of.x[rows, None]) ** 2, axis=0))
    predicted = future + size * random.normal(size=future.shape)
    return Rollouts(of, rows, predicted, predicted.copy())


def test_weights_are_those_of_least_squares_plus_an_error() -> None:
    """Of independent errors: w = q^2 / (q^2 + 1) for an RMSE ratio q."""
    fallback = fallback_of([independent(wandering(1), 2.0)], [independent(wandering(2), 2.0)])
    at = fallback.weights[:, PERSISTENCE, AT]
    assert ((at > 0.75) & (at < 0.95)).all(), at
    between = fallback.weights[KNOWN, PERSISTENCE, 10:19, 0]
    first, last = fallback.weights[KNOWN, PERSISTENCE, [9, 19], 0]
    np.testing.assert_allclose(between, np.linspace(first, last, 11)[1:-1])


def test_each_kind_of_commands_and_channel_has_its_own() -> None:
    good, bad = (rolled(wandering(1), quality) for quality in (0.8, -1.0))
    mixed = good.predicted.copy()
    mixed[:, :, 1] = bad.predicted[:, :, 1]
    both = replace(good, held_input_predictions=mixed)
    weights = fallback_of([both], [both]).weights
    assert (weights[HELD, PERSISTENCE, :, 1] == 1.0).all()
    weights[HELD, PERSISTENCE, :, 1] = 0.0
    assert not weights.any()


def test_errors_on_training_data_count_as_large_as_on_validation_data() -> None:
    good, bad = rolled(wandering(1), 0.8), rolled(wandering(2), -0.2)
    assert fallback_of([good], [bad]).is_active
    assert not fallback_of([good], [rolled(wandering(2), 0.7)]).is_active
    # Too short to say that its ratio is larger.
    few = replace(
        bad,
        rows=bad.rows[:5],
        predicted=bad.predicted[:5],
        held_input_predictions=bad.held_input_predictions[:5],
    )
    assert not fallback_of([good], [few]).is_active


def test_without_validation_nothing_takes_over() -> None:
    bad = rolled(wandering(1), -1.0)
    none = Rollouts(bad.record, bad.rows[:0], bad.predicted[:0], bad.held_input_predictions[:0])
    assert not fallback_of([bad], [none]).is_active
    assert not fallback_of([bad], []).is_active
    assert fallback_of([none], [bad]).is_active
    assert fallback_of([], [bad]).is_active


def test_a_channel_that_is_not_measured_stays() -> None:
    of = wandering(1)
    still = of.x.copy()
    still[:, 1] = 0.0
    bad = rolled(replace(of, x=still, x_ref=still), -1.0)
    bad.predicted[:, :, 1] = 0.3
    weights = fallback_of([bad], [bad]).weights
    assert weights[:, :, :, [0, 2]].any()
    assert not weights[:, :, :, 1].any()


def test_imu_integration_needs_an_imu_everywhere() -> None:
    """A car that accelerates as its IMU says; the model sees nothing of it."""
    n = 2400
    random = np.random.default_rng(3)
    a_x = np.repeat(random.normal(0.0, 2.0, n // 80), 80)
    x = np.zeros((n, 3))
    x[:, 0] = 20.0 + np.concatenate([[0.0], np.cumsum(a_x)[:-1]]) * 0.025
    x += random.normal(0.0, 1e-3, x.shape)
    with_imu = replace(made_record(x), a=np.column_stack([a_x, np.zeros(n)]))
    without = made_record(x)
    weights = fallback_of([rolled(with_imu, -1.0)], [rolled(with_imu, -1.0)]).weights
    assert (weights[:, 2, AT[1:4], 0] > 0.9).all()
    weights = fallback_of([rolled(without, -1.0)], [rolled(with_imu, -1.0)]).weights
    assert not weights[:, 2].any()
    assert weights.any()


def test_the_ratio_of_sums_and_its_error() -> None:
    """Against the spread over many draws of independent blocks."""
    random = np.random.default_rng(0)
    block = np.repeat(np.arange(40), 5)
    drawn = []
    for _ in range(400):
        below = np.repeat(random.gamma(2.0, 1.0, 40), 5)
        above = 0.5 * below + np.repeat(random.normal(0.0, 0.2, 40), 5)
        drawn.append(_ratio(above, below, block))
    ratios, errors = np.array(drawn).T
    assert abs(ratios.mean() - 0.5) < 0.01
    assert 0.9 < errors.mean() / ratios.std() < 1.1
    assert _ratio(np.ones(5), np.ones(5), np.zeros(5, dtype=np.int64)) == (1.0, np.inf)


@pytest.fixture(scope="module")
def without_torque() -> Split:
    """A drive with the same torque throughout, as of a recording that has none."""
    of = record("handling", 240.0)
    u = of.u.copy()
    u[:, 0] = u[:, 0].mean()
    return split_records([replace(of, u=u)])


@pytest.fixture(scope="module")
def fixed(without_torque: Split) -> KoopmanModel:
    return with_fallback(replace(small().run.model, fallback=Fallback.none()), without_torque)


def test_a_model_without_torque_is_never_worse_than_a_naive_predictor(
    without_torque: Split, fixed: KoopmanModel
) -> None:
    (of,), (parts,) = without_torque.records, without_torque.parts
    alone = replace(fixed, fallback=Fallback.none())
    before, after = (score_held_out(model, [(of, parts == TEST)]) for model in (alone, fixed))
    assert before is not None
    assert after is not None
    assert before.ratio.max() > 1.2
    assert after.ratio.max() <= 1.02
    assert after.ratio_held.max() <= min(1.05, before.ratio_held.max())
    assert any(item.channel == "v_x" for item in fixed.fallback.takeovers())


def test_covariances_are_those_of_the_validation_with_the_fallback(
    without_torque: Split, fixed: KoopmanModel
) -> None:
    (of,), (parts,) = without_torque.records, without_torque.parts
    again = rollout_record(fixed, of, None, parts == VALIDATION, stride=8)
    errors = again.predicted - of.x_ref[again.rows[:, None] + np.arange(1, 81)]
    wanted = np.einsum("nhi,nhj->hij", errors, errors) / len(errors)
    np.testing.assert_allclose(fixed.horizon_covariance, wanted, rtol=1e-6, atol=1e-12)


def test_only_training_and_validation_rows_are_used(without_torque: Split) -> None:
    """Test rows may hold anything."""
    (of,), (parts,) = without_torque.records, without_torque.parts
    model = small().run.model
    assert (parts == TRAIN).any()
    validated = [rollout_record(model, of, None, parts == VALIDATION, stride=8)]
    reference = of.x_ref.copy()
    reference[parts == TEST] += 100.0
    altered = replace(of, x_ref=reference)
    one, other = (
        find_fallback(model, Split([each], [parts], "blocks"), validated) for each in (of, altered)
    )
    np.testing.assert_array_equal(one.weights, other.weights)


def test_a_good_model_is_not_given_up_for_a_short_recording() -> None:
    """In 40 s, the validation part is a single block of time, which decides nothing alone."""
    of = record("handling", 40.0)
    parts = np.full(len(of), TRAIN)
    parts[-(len(of) // 10) :] = VALIDATION
    model = replace(small().run.model, fallback=Fallback.none())
    validated = [rollout_record(model, of, None, parts == VALIDATION, stride=8)]
    weights = find_fallback(model, Split([of], [parts], "blocks"), validated).weights
    assert weights[KNOWN].sum(axis=0)[AT].max() < 0.5


def test_a_trained_model_says_what_takes_over() -> None:
    run = small().run
    stored = artefact.load(small().path)
    assert stored.manifest["training"]["fallback"] == run.facts["fallback"]
    assert run.facts["fallback"] == [item.as_json() for item in run.model.fallback.takeovers()]
    np.testing.assert_array_equal(stored.model.fallback.weights, run.model.fallback.weights)


def test_names_are_those_of_the_scores() -> None:
    of = record("town", 60.0)
    assert tuple(naive_predictions(of, np.array([10]), 1)) == NAIVE_PREDICTORS
