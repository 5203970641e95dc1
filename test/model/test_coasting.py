# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Breaks in the grid and missing states: what is forgotten, what goes on and for how long."""

import math
from typing import Any

import numpy as np
import pytest
from helpers.model import (
    HISTORY,
    START_NS,
    fold,
    make_model,
    sample,
    slalom,
)

from adk_ros.errors import UsageError
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.prediction import Status
from adk_ros.model.predictor import Predictor
from adk_ros.signals.channels import TICK_NS, Flag, Sample


@pytest.mark.parametrize("why", ["gap", "backwards", "the same again", "restart"])
def test_a_break_in_the_grid_resets(why: str) -> None:
    first, second = list(slalom(50)), list(slalom(80, seed=1))
    by_ns = {"gap": 60 * TICK_NS, "backwards": -TICK_NS * 9, "the same again": 49 * TICK_NS}
    by_ns["restart"] = 50 * TICK_NS
    flags = int(Flag.RESTART) if why == "restart" else 0
    moved = [s._replace(stamp_ns=s.stamp_ns + by_ns[why], flags=0) for s in second]
    moved[0] = moved[0]._replace(flags=flags)
    predictor, fresh = Predictor(make_model()), Predictor(make_model())
    fold(predictor, first)
    for item in moved:
        one, other = predictor.step(item), fresh.step(item)
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            np.testing.assert_array_equal(one.horizon, other.horizon)
            np.testing.assert_array_equal(one.covariance, other.covariance)
            np.testing.assert_array_equal(one.innovation, other.innovation)


def coasting(k: int, u: Any) -> Sample:
    return sample(k, (math.nan,) * 3, u, int(Flag.COASTING | Flag.ODOMETRY_STALE))


@pytest.mark.parametrize("table", [True, False])
def test_coasting(table: bool) -> None:
    """Predictions go on from themselves, with growing covariance, and then not at all."""
    model = make_model() if table else make_model(horizon_covariance=np.zeros((0, 3, 3)))
    predictor = Predictor(model, horizon_steps=20, max_coast_steps=15)
    samples = list(slalom(60))
    last = fold(predictor, samples)[-1]
    assert last is not None
    free = predictor.rollout(np.tile(samples[-1].u, (16, 1)))
    spread = [np.trace(last.covariance)]
    theta = predictor.online.theta.copy()
    for k in range(15):
        made = predictor.step(coasting(60 + k, samples[-1].u))
        assert made is not None
        assert made.status is predictor.status is Status.COASTING
        assert np.isnan(made.innovation).all()
        assert made.stamp_ns == START_NS + (61 + k) * TICK_NS
        if not k:
            np.testing.assert_allclose(made.x, free[1], atol=1e-2)
        spread.append(np.trace(made.covariance))
    assert (np.diff(spread) > 0.0).all()
    assert predictor.step(coasting(75, samples[-1].u)) is None
    assert predictor.status is Status.NO_STATE
    np.testing.assert_array_equal(predictor.online.theta, theta)
    with pytest.raises(RuntimeError, match="no state"):
        predictor.rollout(np.zeros((3, 2)))
    # A state again: its past has to be gathered first; what was learned is kept.
    again = [predictor.step(sample(76 + k, samples[-1].x, samples[-1].u)) for k in range(3)]
    assert [item is None for item in again] == [True, True, False]
    np.testing.assert_array_equal(predictor.online.theta, theta)
    assert again[2] is not None
    assert np.isnan(again[2].innovation).all()


def test_a_state_back_in_time_goes_on_without_a_break() -> None:
    predictor = Predictor(make_model(), max_coast_steps=15)
    samples = list(slalom(80))
    for k, item in enumerate(samples):
        made = predictor.step(coasting(k, item.u) if 50 <= k < 60 else item)
        assert (made is None) == (k < HISTORY)
    assert made is not None
    assert made.status is Status.PREDICTED
    predicted = predictor.step(coasting(80, samples[-1].u))
    back = predictor.step(sample(81, samples[-1].x, samples[-1].u))
    assert predicted is not None
    assert back is not None
    np.testing.assert_allclose(back.innovation, np.array(samples[-1].x) - predicted.x)


def test_each_time_of_coasting_counts_for_itself() -> None:
    predictor, plain = Predictor(make_model(), max_coast_steps=15), Predictor(make_model())
    for k, item in enumerate(slalom(120)):
        gone = k in range(50, 62) or k in range(70, 82)
        made = predictor.step(coasting(k, item.u) if gone else item)
        other = plain.step(item)
        assert (made is None) == (k < HISTORY)
    assert made is not None
    assert other is not None
    # With a measured state again, nothing of the coasting's doubt is left.
    assert np.trace(made.covariance) < 2.0 * np.trace(other.covariance)


def test_no_coasting_at_all() -> None:
    predictor = Predictor(make_model(), max_coast_steps=0)
    fold(predictor, slalom(20))
    assert predictor.step(coasting(20, (0.0, 0.0))) is None


def test_no_coasting_without_a_prediction() -> None:
    predictor = Predictor(make_model())
    assert fold(predictor, [coasting(k, (0.0, 0.0)) for k in range(5)]) == [None] * 5
    assert predictor.status is Status.NO_STATE


@pytest.mark.parametrize("u", [(math.nan, 0.0), (0.0, math.inf)])
def test_no_command_no_prediction(u: tuple[float, float]) -> None:
    predictor = Predictor(make_model())
    samples = list(slalom(30))
    fold(predictor, samples[:20])
    assert predictor.step(samples[20]._replace(u=u)) is None
    assert predictor.status is Status.NO_STATE
    assert [item is None for item in fold(predictor, samples[21:])] == [True] * 2 + [False] * 7


@pytest.mark.parametrize("history", [0, 3])
def test_covariance_is_symmetric_and_positive(history: int) -> None:
    predictor = Predictor(make_model(history=history), horizon_steps=0)
    for k, item in enumerate(slalom(500)):
        gone = 200 <= k < 230
        made = predictor.step(coasting(k, item.u) if gone else item)
        if made is not None:
            np.testing.assert_array_equal(made.covariance, made.covariance.T)
            assert np.linalg.eigvalsh(made.covariance).min() > 0.0


@pytest.mark.parametrize("flags", [0, int(Flag.COMMAND_STALE)])
def test_disturbances_decay_while_nothing_is_learned(flags: int) -> None:
    """As along the horizon of before: else 40 ticks of coasting add 40 times the last residual."""
    gains = ObserverGains(
        np.full(3, 0.5), np.full(3, 0.1), np.full(3, 0.9), np.full(3, 0.5), np.full(3, 0.6)
    )
    predictor = Predictor(make_model(observer_gains=gains))
    samples = list(slalom(80))
    fold(predictor, samples[:60])
    before = predictor._memory.disturbance.copy()
    assert np.abs(before[:2]).min() > 0.0
    for k in range(10):
        lost = samples[60 + k]._replace(flags=flags) if flags else coasting(60 + k, samples[59].u)
        assert predictor.step(lost) is not None
    after = predictor._memory.disturbance
    np.testing.assert_allclose(after[0], before[0] * 0.9**10, rtol=1e-9)
    np.testing.assert_allclose(after[1], before[1] * 0.6**10, rtol=1e-9)


def test_a_level_change_is_not_compared_with_what_was_predicted_before() -> None:
    """A sensor that reads 1 m/s more: no error of the model, whose covariance stays."""
    calm = Predictor(make_model(), horizon_steps=40)
    changed = Predictor(make_model(), horizon_steps=40)
    spread = np.zeros((2, 40))
    for k, item in enumerate(slalom(200)):
        x = np.array(item.x) + np.array([1.0 if k >= 120 else 0.0, 0.0, 0.0])
        flags = int(Flag.LEVEL_CHANGE) if k == 120 else item.flags
        made = calm.step(item), changed.step(item._replace(x=tuple(x), flags=flags))
        for i, one in enumerate(made):
            if one is not None:
                spread[i] = one.horizon_covariance[:, 0, 0]
    assert (spread[1] < 1.5 * spread[0]).all()


def test_no_rollouts_after_a_prediction_that_was_withheld() -> None:
    predictor = Predictor(make_model())
    fold(predictor, list(slalom(60)))
    predictor.roll_out_many(np.zeros((1, 5, 2)))
    predictor.status = Status.IMPLAUSIBLE
    with pytest.raises(UsageError, match="no state to predict from"):
        predictor.roll_out_many(np.zeros((1, 5, 2)))
    with pytest.raises(RuntimeError, match="no state"):
        predictor.rollout(np.zeros((5, 2)))
