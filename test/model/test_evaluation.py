# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rollouts along a record equal those of the predictor that runs on the vehicle."""

import numpy as np
import pytest
from helpers.model import make_model
from helpers.signals import drive, in_order, without

from adk_ros.model import evaluation
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.evaluation import WARM_UP_STEPS, rollout_record, sample_at
from adk_ros.model.predictor import Predictor
from adk_ros.signals.align import align_samples
from adk_ros.signals.channels import TICK_NS, Record, Source
from adk_ros.signals.record import build_record
from adk_ros.signals.score import scorable_rows, score
from adk_ros.train.hyperparameters import windowed


@pytest.fixture(scope="module")
def record() -> Record:
    return build_record(in_order(drive(15.0, noise=1e-3)), "slalom")


def test_row_converts_back_to_its_sample(record: Record) -> None:
    samples = align_samples(in_order(drive(15.0, noise=1e-3)))
    for row in (0, 7, len(record) - 1):
        assert sample_at(record, row) == samples[row]


@pytest.mark.parametrize("method", ["windowed", "constant"])
def test_rollouts_equal_the_predictors(record: Record, method: str) -> None:
    model, online = make_model(), OnlineSettings(method, 100, 1.0)
    rolled = rollout_record(model, record, online, ahead=20, stride=7)
    assert rolled.rows.tolist() == scorable_rows(record, 8, 20)[::7].tolist()
    assert (
        rolled.predicted.shape == rolled.held_input_predictions.shape == (len(rolled.rows), 20, 3)
    )
    predictor = Predictor(model, online, horizon_steps=20)
    wanted = {int(row): k for k, row in enumerate(rolled.rows)}
    for row in range(int(rolled.rows[-1]) + 1):
        made = predictor.step(sample_at(record, row))
        if row in wanted:
            assert made is not None
            k = wanted[row]
            np.testing.assert_array_equal(rolled.held_input_predictions[k], made.horizon)
            known = predictor.rollout(record.u[row : row + 20])
            np.testing.assert_array_equal(rolled.predicted[k], known)
            # The first command is the row's own, so both agree one tick ahead.
            np.testing.assert_array_equal(
                rolled.predicted[k, 0], rolled.held_input_predictions[k, 0]
            )
    result = score(record, rolled.rows, rolled.predicted, (1, 20))
    assert result.diverged == 0
    assert (result.rmse[0] < [0.1, 0.05, 0.05]).all()


def test_only_commands_after_a_row_enter_its_prediction(record: Record) -> None:
    cut = 300
    changed = record.rows(np.arange(len(record)))
    changed.x[cut + 1 :] += 1.0
    model = make_model()
    one = rollout_record(model, record, ahead=20)
    other = rollout_record(model, changed, ahead=20)
    early = one.rows <= cut
    assert early.sum() > 50
    np.testing.assert_array_equal(one.predicted[early], other.predicted[early])
    assert (one.predicted[~early][5] != other.predicted[~early][5]).all()


def test_only_rows_with_their_whole_horizon_in_the_mask_are_scored(record: Record) -> None:
    scored = np.zeros(len(record), dtype=bool)
    scored[300:400] = True
    rolled = rollout_record(make_model(), record, scored=scored, ahead=20, stride=1)
    assert rolled.rows.tolist() == list(range(300, 380))
    whole = rollout_record(make_model(), record, ahead=20, stride=1)
    chosen = np.isin(whole.rows, rolled.rows)
    np.testing.assert_array_equal(whole.predicted[chosen], rolled.predicted)


def test_warm_up_is_fifty_seconds_and_fills_the_default_window() -> None:
    warm_up_s = WARM_UP_STEPS * TICK_NS * 1e-9
    assert warm_up_s == pytest.approx(50.0)
    assert windowed(1.0).window <= WARM_UP_STEPS
    record = build_record(in_order(drive(60.0, 50, 40, 40)))
    scored = np.zeros(len(record), dtype=bool)
    scored[2100:2200] = True
    calls: list[tuple[int, int]] = []
    rolled = rollout_record(
        make_model(), record, scored=scored, ahead=20, stride=4,
        progress=lambda done, total: calls.append((done, total)),
    )  # fmt: skip
    total = calls[-1][1]
    assert calls[0] == (0, total)
    assert calls[-1] == (total, total)
    assert total == rolled.rows[-1] - rolled.rows[0] + WARM_UP_STEPS + 1


def test_the_predictors_settings_are_not_changed(
    record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    horizons = []

    class Watched(Predictor):
        def __setattr__(self, name: str, value: object) -> None:
            if name == "horizon_steps":
                horizons.append(value)
            super().__setattr__(name, value)

    monkeypatch.setattr(evaluation, "Predictor", Watched)
    assert rollout_record(make_model(), record, ahead=20, stride=7).rows.size
    assert horizons == [20]


def test_step_without_horizon_predicts_the_same_state(record: Record) -> None:
    with_horizon, without_horizon = Predictor(make_model()), Predictor(make_model())
    for row in range(100):
        sample = sample_at(record, row)
        full = with_horizon.step(sample)
        short = without_horizon.step(sample, with_horizon=False)
        assert (full is None) == (short is None)
        if full is not None and short is not None:
            assert short.horizon.shape == (0, 3)
            np.testing.assert_array_equal(short.x, full.x)
    assert without_horizon.horizon_steps == 80


def test_no_rollout_crosses_a_gap() -> None:
    readings = without(in_order(drive(12.0, 0, 50, 40)), Source.ODOMETRY, 5.0, 7.0)
    record = build_record(readings)
    rolled = rollout_record(make_model(), record, ahead=20, stride=1)
    t = (record.stamp_ns[rolled.rows] - record.stamp_ns[0]) * 1e-9
    assert not ((t > 4.6) & (t < 7.0)).any()
    assert np.isfinite(rolled.predicted).all()
    assert (t < 4.5).sum() > 150
    assert (t > 7.3).sum() > 100


def test_record_shorter_than_the_horizon_has_no_rollouts() -> None:
    record = build_record(in_order(drive(1.0)))
    rolled = rollout_record(make_model(), record, ahead=80)
    assert rolled.rows.shape == (0,)
    assert rolled.predicted.shape == rolled.held_input_predictions.shape == (0, 80, 3)
