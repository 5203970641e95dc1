# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Requests for predictions under many candidate commands."""

import math
from pathlib import Path

import numpy as np
import pytest
from helpers.node import Rig, write_model

from adk_ros.model import artefact, rollout_requests
from adk_ros.model.drivable import is_drivable
from adk_ros.model.rollout_requests import MAX_STEPS, RefusedRequest, with_drivable


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    model = write_model(tmp_path_factory.mktemp("requests") / "model")
    rig = Rig(artefact.load(model).model)
    rig.drive(3.0)
    return rig


def test_the_answer_is_that_of_the_predictor(rig: Rig) -> None:
    commands = np.random.default_rng(0).normal(0.0, [200.0, 0.02], (5, 12, 2))
    stamp_ns, states = rig.core.rollouts.answer((5, 12, 2), commands.ravel())
    assert stamp_ns == rig.published[-1].origin_ns
    assert states.shape == (5, 12, 4)
    expected = rig.pipeline.predictor.roll_out_many(commands)
    np.testing.assert_array_equal(states[..., :3], expected)
    assert (states[..., 3] == 1.0).all()
    np.testing.assert_array_equal(rig.pipeline.predictor.rollout(commands[2]), expected[2])


def test_a_candidate_that_no_vehicle_follows_is_marked(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rollout_requests, "MAX_DRIVE", 1e7)
    commands = np.zeros((2, 80, 2))
    commands[1, :, 0] = 1e7
    _, states = rig.core.rollouts.answer(commands.shape, commands)
    assert np.isfinite(states).all()
    assert states[0, :, 3].tolist() == [1.0] * 80
    assert states[1, :, 3].tolist() == [0.0] * 80


def test_all_candidates_are_judged_as_each_by_itself() -> None:
    rng = np.random.default_rng(2)
    present = np.array([20.0, 0.3, 0.1])
    states = present + rng.normal(0.0, [2.0, 1.0, 0.5], (300, 3, 3))
    for k, unusable in enumerate([math.nan, math.inf, -math.inf, 500.0]):
        states[3 * k, 1, k % 3] = unusable
    answer = with_drivable(present, states)
    expected = [float(is_drivable(present, candidate)) for candidate in states]
    assert 0.1 < np.mean(expected) < 0.9
    np.testing.assert_array_equal(answer[..., :3], states)
    np.testing.assert_array_equal(answer[..., 3], np.repeat(expected, 3).reshape(300, 3))


@pytest.mark.parametrize(
    ("shape", "values", "reason"),
    [
        ((4, 2), np.zeros(8), "the layout has other dimensions ([4, 2]: give [candidates, steps,"),
        ((1, 0, 2), np.zeros(0), "the layout has other dimensions"),
        ((1, 4, 3), np.zeros(12), "the layout has other dimensions"),
        ((), np.zeros(0), "the layout has other dimensions"),
        ((MAX_STEPS, 2, 2), np.zeros(1), f"too many steps ({MAX_STEPS} x 2: give at most"),
        ((1, 401, 2), np.zeros(802), "too many steps (1 x 401: give at most 400 steps"),
        ((390, 400, 2), np.zeros(1), "too many steps (390 x 400, computed as 448 x 400: give"),
        ((2, 3, 2), np.zeros(11), "another number of values than the layout says (11 for 2 x 3"),
        ((1, 2, 2), [0.0, 0.0, math.nan, 0.0], "a command is not finite (number 2"),
        ((1, 2, 2), [0.0, 0.0, math.inf, 0.0], "a command is not finite (number 2"),
        ((2, 2, 2), [0.0] * 6 + [-1e9, 0.0], "a wheel torque is beyond 1e+06 N·m (-1e+09 N·m, ca"),
        (
            (2, 2, 2), [0.0] * 5 + [15.0, 0.0, 0.0],
            "a road-wheel angle is beyond 1.5708 rad (15 rad, candidate 1, step 0, from 0)",
        ),
    ],
)  # fmt: skip
def test_a_request_without_answer_says_why(
    rig: Rig, shape: tuple[int, ...], values: object, reason: str
) -> None:
    before = rig.core.rollouts.refused.total()
    with pytest.raises(RefusedRequest) as refusal:
        rig.core.rollouts.answer(shape, values)  # type: ignore[arg-type]
    assert str(refusal.value).startswith(reason)
    assert rig.core.rollouts.refused.total() == before + 1


def test_a_model_without_a_compiled_encoder_answers_less(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One candidate after the other, and the interpreter takes several times as long."""
    monkeypatch.setattr(rig.pipeline.predictor.model.lifting, "compiled", None)
    with pytest.raises(RefusedRequest, match=r"too many steps \(6 x 80: give at most 400 cand"):
        rig.core.rollouts.answer((6, 80, 2), np.zeros(960))


def test_there_is_no_answer_without_a_state(tmp_path: Path) -> None:
    rig = Rig(artefact.load(write_model(tmp_path / "model")).model)
    with pytest.raises(RefusedRequest, match=r"no state to predict from \(warming up\)"):
        rig.core.rollouts.answer((1, 2, 2), np.zeros(4))
    first = rig.drive(2.0)[0]
    assert "1 roll_out requests refused: no state to predict from" in first.message
    assert rig.core.rollouts.answer((1, 2, 2), np.zeros(4))[1].shape == (1, 2, 4)
    rig.core.reset()
    with pytest.raises(RefusedRequest, match="no state to predict from"):
        rig.core.rollouts.answer((1, 2, 2), np.zeros(4))
    report = rig.report()
    assert "1 roll_out requests refused: no state to predict from" in report.message
    values = dict(report.values)
    assert values["roll_out.received"] == "3"
    assert values["roll_out.refused: no state to predict from"] == "2"


def test_the_blocks_are_the_local_linear_model(rig: Rig) -> None:
    commands = np.random.default_rng(1).normal(0.0, [200.0, 0.02], (20, 2))
    linear = rig.pipeline.predictor.linearized(commands)
    blocks = linear.blocks()
    n = linear.states.shape[1]
    assert blocks.shape == (21, n + 3, n + 3)
    state = blocks[0, :n, -1]
    for block, command, predicted in zip(blocks[1:], commands, linear.predicted, strict=True):
        state = block[:n] @ np.concatenate([state, command, [1.0]])
        output = block[n:] @ np.concatenate([state, np.zeros(2), [1.0]])
        np.testing.assert_allclose(output, predicted, atol=1e-9)
    np.testing.assert_allclose(predicted, rig.pipeline.predictor.rollout(commands)[-1], atol=1e-4)
