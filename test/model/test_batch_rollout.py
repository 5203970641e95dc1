# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rollouts of many candidates are those of each candidate alone."""

from typing import Any

import numpy as np
import pytest
from helpers.model import fold, make_model, sample, slalom
from helpers.rollouts import MODELS, MONITORED, adapted, candidates

from adk_ros.errors import UsageError
from adk_ros.model.predictor import Predictor
from adk_ros.model.uncertainty.batch_rollout import BLOCK


@pytest.mark.parametrize("name", MODELS)
def test_each_candidate_equals_its_single_rollout(name: str) -> None:
    model = MODELS[name]()
    for seed, (count, steps) in enumerate([(BLOCK + 5, 33), (1, 1), (17, 90)]):
        predictor = adapted(model, 60 + 15 * seed, seed)
        commands = candidates(count, steps)
        states = predictor.roll_out_many(commands)
        single = np.array([predictor.rollout(one) for one in commands])
        np.testing.assert_array_equal(states, single)
        assert np.abs(states[0, -1] - states[-1, -1]).max() > 0.0 or count == 1


def test_any_array_of_numbers_is_taken_and_kept() -> None:
    predictor, commands = adapted(make_model()), candidates(6, 8)
    expected = predictor.roll_out_many(commands)
    kept = commands.copy()
    np.testing.assert_array_equal(predictor.roll_out_many(commands[::2]), expected[::2])
    np.testing.assert_array_equal(commands, kept)
    whole = np.zeros((2, 3, 2), dtype=np.int64)
    np.testing.assert_array_equal(
        predictor.roll_out_many(whole.tolist()),
        predictor.roll_out_many(whole),
    )
    for shape in ((0, 5, 2), (5, 0, 2), (0, 0, 2)):
        assert predictor.roll_out_many(np.zeros(shape)).shape == (*shape[:2], 3)


def test_a_rollout_does_not_change_the_predictor() -> None:
    one, other = (
        adapted(make_model(mean_square_change=MONITORED)),
        adapted(make_model(mean_square_change=MONITORED)),
    )
    one.roll_out_many(candidates(20, 30))
    for item in list(slalom(100))[90:]:
        made, expected = one.step(item), other.step(item)
        assert made is not None
        assert expected is not None
        np.testing.assert_array_equal(made.x, expected.x)


@pytest.mark.parametrize("name", ["monitored", "naive", "paper"])
def test_at_standstill_states_are_finite_and_equal(name: str) -> None:
    predictor = Predictor(MODELS[name](), horizon_steps=0)
    fold(predictor, [sample(k, (0.0, 0.0, 0.0), (0.0, 0.0)) for k in range(30)])
    commands = candidates(5, 80) * 0.1
    commands[0] = 0.0
    states = predictor.roll_out_many(commands)
    assert np.isfinite(states).all()
    np.testing.assert_array_equal(states, [predictor.rollout(one) for one in commands])


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        (np.zeros((3, 2)), r"commands have shape \(3, 2\): give \(k, h, 2\), the last axis wheel"),
        (np.zeros((3, 4, 3)), r"commands have shape \(3, 4, 3\)"),
        (np.zeros(()), r"commands have shape \(\)"),
        ([[[1.0, "left"]]], r"commands are not an array of numbers of shape \(k, h, 2\)"),
        ([[[1.0, 0.0]], [[0.0, np.nan]]], r"command \(1, 0, 1\) is nan: give finite wheel"),
        ([[[-np.inf, 0.0]]], r"command \(0, 0, 0\) is -inf"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("compiled", [True, False])
def test_unusable_commands_are_refused(commands: Any, message: str, compiled: bool) -> None:
    predictor = adapted(make_model(compiled=compiled))
    with pytest.raises(UsageError, match=message) as caught:
        predictor.roll_out_many(commands)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["monitored", "naive", "TorchScript", "paper"])
def test_states_that_are_not_finite_are_refused(name: str) -> None:
    predictor = adapted(MODELS[name]())
    predictor.online.theta[:, 0] = np.nan
    message = (
        "candidate 0 leads to states that are not finite: its wheel torques reach 900 N·m and"
    )
    with pytest.raises(UsageError, match=message):
        predictor.roll_out_many(np.full((BLOCK + 1, 3, 2), -900.0))


def test_without_a_state_there_is_no_rollout() -> None:
    predictor = Predictor(make_model())
    with pytest.raises(UsageError, match=r"no state to predict from \(warming up\): give the"):
        predictor.roll_out_many(candidates(2, 3))
