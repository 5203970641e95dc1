# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The held-out table on constructed cases: right ratios, and a reason for each lost cell."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers.train import made_record, record, small

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder import Lifting, input_size
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.training_range import TrainingRange
from adk_ros.signals.channels import STATE_NAMES, Flag, Record
from adk_ros.signals.score import HORIZON_STEPS
from adk_ros.train.dataset import TEST, TRAIN, split_records
from adk_ros.train.held_out import (
    HELD_INPUTS,
    MODEL,
    TIE,
    HeldOutScores,
    score_held_out,
)
from adk_ros.train.network import Encoder, Lift, to_torchscript
from adk_ros.train.report_figures import horizon_figure


def linear_model(change: np.ndarray) -> KoopmanModel:
    """A model that adds `change` (3, 6) times [x, feature, u] to the state, in SI units."""
    encoder = Encoder(0, 4, 1)
    with torch.no_grad():
        for value in encoder.parameters():
            value.zero_()
    program = to_torchscript(Lift(encoder, torch.zeros(1), torch.ones(1)))
    theta = np.zeros((4, 7))
    theta[:3, :6] = change
    return KoopmanModel(
        lifting=Lifting(program, input_size(0), 1),
        scaling=Scaling(np.zeros(3), np.ones(3), np.zeros(2), np.ones(2), np.ones(3)),
        theta0=theta,
        history=0,
        residual=True,
        affine=True,
        relift=True,
        observer_gains=ObserverGains.none(),
        horizon_covariance=np.zeros((0, 3, 3)),
        mean_square_change=np.zeros((0, 3)),
        uses_imu=False,
        online=OnlineSettings("constant"),
    )


STILL = linear_model(np.zeros((3, 6)))


def wandering(n: int = 1200, seed: int = 0, deviation: float = 0.02) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(0.0, deviation, (n, 3)), axis=0)
    shifted: np.ndarray = x + np.array([15.0, 0.0, 0.0])
    return shifted


def rms(of: Record, rows: np.ndarray, step: int, predicted: np.ndarray) -> np.ndarray:
    root: np.ndarray = np.sqrt(np.mean((predicted - of.x_ref[rows + step]) ** 2, axis=0))
    return root


def scored(
    model: KoopmanModel, *records: Record, known: TrainingRange | None = None
) -> HeldOutScores:
    result = score_held_out(model, [(item, None) for item in records], known)
    assert result is not None
    return result


def test_ratios_against_the_naive_predictors_computed_here() -> None:
    of = made_record(wandering())
    result = scored(STILL, of)
    rows = result.rollouts[0].rows
    assert result.scores[MODEL].count == rows.size > 250
    for i, step in enumerate(HORIZON_STEPS):
        still = rms(of, rows, step, of.x[rows])
        line = rms(of, rows, step, of.x[rows] + step * (of.x[rows] - of.x[rows - 1]))
        np.testing.assert_allclose(result.scores["persistence"].rmse[i], still)
        np.testing.assert_allclose(result.scores["straight line"].rmse[i], line)
        np.testing.assert_allclose(result.scores[MODEL].rmse[i], still)
        np.testing.assert_allclose(result.naive[i], np.minimum(still, line))
    np.testing.assert_allclose(result.ratio, 1.0)
    assert "IMU integration" not in result.scores


def test_scores_under_known_and_held_commands(unshrunk: None) -> None:
    """A car that does what its command says: known it is exact, held it is as good as a guess."""
    n = 1200
    rng = np.random.default_rng(3)
    u = rng.normal(0.0, 1.0, (n, 2))
    gain = np.array([[0.01, 0.0], [0.0, 0.02], [0.0, 0.03]])
    x = np.vstack([np.zeros(3), np.cumsum(u @ gain.T, axis=0)[:-1]])
    x[:, 0] += 12.0
    change = np.zeros((3, 6))
    change[:, 4:] = gain
    of = made_record(x, u)
    result = scored(linear_model(change), of)
    np.testing.assert_allclose(result.scores[MODEL].rmse, 0.0, atol=1e-9)
    assert result.lost == {}
    rows = result.rollouts[0].rows
    for i, step in enumerate(HORIZON_STEPS):
        held = rms(of, rows, step, of.x[rows] + step * (u[rows] @ gain.T))
        np.testing.assert_allclose(result.scores[HELD_INPUTS].rmse[i], held, atol=1e-9)


def test_all_records_count_by_their_starts() -> None:
    first, second = made_record(wandering(1200, 1)), made_record(wandering(500, 2))
    both = scored(STILL, first, second)
    apart = [scored(STILL, item) for item in (first, second)]
    counts = np.array([item.scores[MODEL].count for item in apart])
    assert both.scores[MODEL].count == counts.sum()
    squares = [
        count * item.scores[MODEL].rmse ** 2 for count, item in zip(counts, apart, strict=True)
    ]
    np.testing.assert_allclose(both.scores[MODEL].rmse, np.sqrt(sum(squares) / counts.sum()))


def test_a_predictor_that_one_record_lacks_is_left_out() -> None:
    """IMU integration is not compared where a record has no IMU."""
    with_imu = record("town", 60.0)
    assert "IMU integration" in scored(small().run.model, with_imu).scores
    without = record("town", 60.0, imu=False)
    assert "IMU integration" not in scored(small().run.model, with_imu, without).scores


def test_only_the_part_asked_for_is_scored() -> None:
    of = made_record(wandering())
    mask = np.zeros(len(of), dtype=bool)
    mask[500:800] = True
    result = score_held_out(STILL, [(of, mask)])
    assert result is not None
    rows = result.rollouts[0].rows
    assert rows.min() >= 500
    assert rows.max() + HORIZON_STEPS[-1] < 800


def test_no_start_with_a_whole_horizon_returns_none() -> None:
    assert score_held_out(STILL, [(made_record(wandering(60)), None)]) is None
    assert score_held_out(STILL, []) is None
    of = made_record(wandering())
    assert score_held_out(STILL, [(of, np.zeros(len(of), dtype=bool))]) is None
    flags = np.full(len(of), int(Flag.ODOMETRY_STALE))
    assert score_held_out(STILL, [(replace(of, flags=flags), None)]) is None


def test_progress_reaches_its_end() -> None:
    told: list[tuple[int, int]] = []
    score_held_out(
        STILL, [(made_record(wandering()), None)] * 2, progress=lambda *at: told.append(at)
    )
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert told[-1][0] == told[-1][1]


def test_a_cell_lost_to_noise() -> None:
    """A car that stands still, seen through noise: nobody can do better than guess the mean."""
    rng = np.random.default_rng(0)
    x = rng.normal(0.0, 0.05, (1200, 3))
    result = scored(STILL, made_record(x))
    assert len(result.lost) == 15
    assert set(result.lost) == {
        f"{name} at {step * 0.025:g} s" for name in STATE_NAMES for step in HORIZON_STEPS
    }
    for why in result.lost.values():
        assert why.startswith("1.00 times the best naive predictor's RMSE; ")
        assert "both are within twice the measurement's noise (" in why


def test_a_cell_lost_beyond_the_training() -> None:
    trained_on = TrainingRange.of([made_record(wandering())])
    fast = wandering()
    fast[:, 0] += 20.0
    result = scored(STILL, made_record(fast), known=trained_on)
    for name in STATE_NAMES:
        why = result.lost[f"{name} at 1 s"]
        assert "in 100 % of the rollouts v_x" in why
        assert "beyond" in why
    within = scored(STILL, made_record(wandering()), known=trained_on)
    assert not any("beyond" in why for why in within.lost.values())


def test_a_cell_lost_by_few_starts() -> None:
    x = wandering(1200, deviation=1e-3)
    x[600:, 0] += 10.0
    result = scored(STILL, made_record(x))
    assert "% of the squared error comes from 5 % of the rollouts" in result.lost["v_x at 0.25 s"]


def test_a_cell_lost_throughout() -> None:
    t = 0.025 * np.arange(1200)
    x = np.column_stack([15.0 + t, 0.1 * np.sin(t), 0.1 * np.cos(t)])
    result = scored(STILL, made_record(x))
    assert "the error is spread evenly over the rollouts" in result.lost["v_x at 1 s"]
    assert result.ratio[3, 0] > 1e3


def test_a_model_that_diverges_has_a_score() -> None:
    change = np.zeros((3, 6))
    change[1, 1] = 3.0
    x = wandering(600)
    result = scored(linear_model(change), made_record(x))
    assert np.isfinite(result.ratio).all()
    json.dumps(result.as_json(), allow_nan=False)


def test_as_json_equals_the_scores_and_is_valid_json() -> None:
    test = small().run.test
    assert test is not None
    told = json.loads(json.dumps(test.as_json(), allow_nan=False))
    assert told == test.as_json()
    assert told["horizons_s"] == [0.025, 0.25, 0.5, 1.0, 2.0]
    assert told["starts"] == test.scores[MODEL].count
    assert list(told["predictors"]) == list(test.scores)
    for name, item in test.scores.items():
        for c, channel in enumerate(STATE_NAMES):
            assert told["predictors"][name][channel]["rmse"] == item.rmse[:, c].tolist()
            assert told["predictors"][name][channel]["max"] == item.worst[:, c].tolist()
    naive = ("persistence", "straight line", "IMU integration")
    for c, channel in enumerate(STATE_NAMES):
        best = np.min([told["predictors"][name][channel]["rmse"] for name in naive], axis=0)
        ours = np.array(told["predictors"][MODEL][channel]["rmse"])
        np.testing.assert_allclose(told["ratio_to_best_naive"][channel], ours / best)
        rows = np.flatnonzero(ours / best >= TIE)
        lost = {f"{channel} at {told['horizons_s'][i]:g} s" for i in rows}
        assert {cell for cell in told["lost_cells"] if cell.startswith(channel)} == lost
        assert np.all(test.ratio[1:, c] < 1.0), "a usable model wins from 0.25 s on"
    mean = np.exp(np.mean(np.log(test.ratio)))
    assert told["geometric_mean_ratio"] == pytest.approx(mean)


def test_only_the_test_part_is_scored() -> None:
    run = small().run
    assert run.test is not None
    (of,) = run.split.records
    (parts,) = split_records([of]).parts
    for rolled in run.test.rollouts:
        window = rolled.rows[:, None] + np.arange(HORIZON_STEPS[-1] + 1)
        assert (parts[window] == TEST).all()
    assert (parts == TRAIN).any()


def test_a_velocity_that_is_not_measured_has_no_score(tmp_path: Path) -> None:
    x = record().x.copy()
    x[:, 1] = 0.0
    scores = score_held_out(STILL, [(made_record(x, record().u), None)])
    assert scores is not None
    about = scores.as_json()
    json.dumps(about, allow_nan=False)
    assert about["ratio_to_best_naive"]["v_y"] == [None] * len(HORIZON_STEPS)
    assert np.isfinite(about["geometric_mean_ratio"])
    assert not any(cell.startswith("v_y") for cell in scores.lost)
    # A logarithmic axis without values ends in an error.
    horizon_figure(scores, tmp_path / "horizon.png")
    assert (tmp_path / "horizon.png").stat().st_size > 10_000
