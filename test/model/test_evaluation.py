# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A model's errors on a record are those of the very predictor that runs on the vehicle."""

import numpy as np
import pytest
from helpers.model import make_model
from helpers.signals import drive, in_order, without

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.evaluation import WARM_UP_STEPS, rollout_record, sample_at
from adk_ros.model.predictor import Predictor
from adk_ros.signals.align import align_samples
from adk_ros.signals.channels import Record, Source
from adk_ros.signals.record import build_record
from adk_ros.signals.score import scorable_rows, score


@pytest.fixture(scope="module")
def record() -> Record:
    return build_record(in_order(drive(15.0, noise=1e-3)), "slalom")


def test_a_row_is_the_sample_it_came_from(record: Record) -> None:
    samples = align_samples(in_order(drive(15.0, noise=1e-3)))
    for row in (0, 7, len(record) - 1):
        assert sample_at(record, row) == samples[row]


@pytest.mark.parametrize("method", ["windowed", "constant"])
def test_predictions_are_the_predictors(record: Record, method: str) -> None:
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
            # The first command is the one in force at the row itself: a tick ahead both agree.
            np.testing.assert_array_equal(
                rolled.predicted[k, 0], rolled.held_input_predictions[k, 0]
            )
    result = score(record, rolled.rows, rolled.predicted, (1, 20))
    assert result.diverged == 0
    assert (result.rmse[0] < [0.1, 0.05, 0.05]).all()


def test_nothing_after_a_row_enters_but_the_commands(record: Record) -> None:
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


def test_only_what_is_asked_for_is_scored(record: Record) -> None:
    """With its whole horizon; what comes before may be adapted on, as on the vehicle."""
    scored = np.zeros(len(record), dtype=bool)
    scored[300:400] = True
    rolled = rollout_record(make_model(), record, scored=scored, ahead=20, stride=1)
    assert rolled.rows.tolist() == list(range(300, 380))
    whole = rollout_record(make_model(), record, ahead=20, stride=1)
    chosen = np.isin(whole.rows, rolled.rows)
    np.testing.assert_array_equal(whole.predicted[chosen], rolled.predicted)


def test_warm_up_is_limited() -> None:
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


def test_a_gap_resets_and_is_not_predicted_across() -> None:
    readings = without(in_order(drive(12.0, 0, 50, 40)), Source.ODOMETRY, 5.0, 7.0)
    record = build_record(readings)
    rolled = rollout_record(make_model(), record, ahead=20, stride=1)
    t = (record.stamp_ns[rolled.rows] - record.stamp_ns[0]) * 1e-9
    assert not ((t > 4.6) & (t < 7.0)).any()
    assert np.isfinite(rolled.predicted).all()
    assert (t < 4.5).sum() > 150
    assert (t > 7.3).sum() > 100


def test_nothing_to_score() -> None:
    record = build_record(in_order(drive(1.0)))
    rolled = rollout_record(make_model(), record, ahead=80)
    assert rolled.rows.shape == (0,)
    assert rolled.predicted.shape == rolled.held_input_predictions.shape == (0, 80, 3)
