# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of `adk bench confirm --sources`: what each leaves out, and where the plant starts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.model import make_model
from helpers.train import drive

from adk_ros.bench.paper import cases
from adk_ros.bench.paper.cases import CLEAN, NOISY
from adk_ros.bench.paper.confirmation_criteria import confirmation_criteria
from adk_ros.bench.paper.error_sources import (
    EstimatedStartOracle,
    reduced_predictors,
)
from adk_ros.bench.paper.paper_tables import Table
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    ALONE,
    NOT_ADAPTED,
    ORACLE_ESTIMATED,
    KoopmanPredictor,
    OraclePredictor,
)
from adk_ros.bench.paper.ratios import summary_table
from adk_ros.bench.paper.scores import ScoreTable
from adk_ros.bench.paper.training_jobs import BenchPlan, TrainingJob, default_job, naive_job
from adk_ros.model.evaluation import observed_states, sample_at
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.train.train_settings import TrainSettings

pytestmark = pytest.mark.slow

BEGIN = 400


def monitored_model(gain: float = 1.0) -> KoopmanModel:
    """A model with a monitor and disturbances, and this gain of the observer."""
    model = make_model()
    gains = replace(model.observer_gains, observer_gain=np.full(3, gain))
    change = np.full((80, 3), 0.1)
    return replace(model, observer_gains=gains, mean_square_change=change)


def test_each_row_leaves_out_what_it_says() -> None:
    measured = cases.noisy(drive("town", 30.0).truth().rows(slice(BEGIN, None)), 1)
    model = monitored_model(0.5)
    fixed, alone = reduced_predictors(KoopmanPredictor(ADK_ROS, model))
    assert (fixed.name, alone.name) == (NOT_ADAPTED, ALONE)
    rows, starts = cases.rows_of(measured, 100)
    passed = {}
    for each in (KoopmanPredictor(ADK_ROS, model), fixed, alone):
        passed[each.name] = each.run(measured, rows, starts).ahead
        predictor = Predictor(each.model, each.online)
        for row in range(300):
            predictor.step(sample_at(measured, row))
        is_adapted = not np.array_equal(predictor.online.theta, model.theta0)
        assert is_adapted == (each.name == ADK_ROS)
        assert predictor.disturbance.any() == (each.name != ALONE)
        assert (predictor.rollout_monitor is None) == (each.name == ALONE)
        # The observer is part of all of them.
        assert not np.array_equal(predictor.filtered_state, measured.x[299])
    assert not np.allclose(passed[ADK_ROS], passed[NOT_ADAPTED], rtol=1e-6, atol=0.0)
    assert not np.allclose(passed[NOT_ADAPTED], passed[ALONE], rtol=1e-6, atol=0.0)


def test_the_plant_starts_from_the_estimated_state() -> None:
    driven = drive("town", 30.0)
    truth = driven.truth().rows(slice(BEGIN, None))
    measured = cases.noisy(truth, 1)
    rows, _ = cases.rows_of(measured, 100)
    rows = rows[:200:50]
    exact = EstimatedStartOracle(driven, BEGIN, monitored_model()).predict(truth, rows, 10)
    assert np.abs(exact[:, 9] - truth.x[rows + 10]).max() < 1e-9
    filtered = monitored_model(0.5)
    found = EstimatedStartOracle(driven, BEGIN, filtered).predict(measured, rows, 10)
    from_measured = OraclePredictor(driven, BEGIN).predict(measured, rows, 10)
    assert not np.allclose(found, from_measured, rtol=1e-6, atol=0.0)
    states = observed_states(filtered, measured, len(measured))
    given = OraclePredictor(driven, BEGIN).predict(replace(measured, x=states), rows, 10)
    np.testing.assert_array_equal(found, given)


@pytest.mark.slow(seconds=40)
def test_the_rows_stand_in_the_table_and_are_never_the_best(tmp_path: Path) -> None:
    plan = BenchPlan(
        quick=True, seeds=1, tests=("nominal",), stride=40, peers=False, sources=True,
        durations=cases.Durations(train=60.0, test=8.0),
        train=TrainSettings(
            steps=20, batch=32, hidden=8, features=4, history=2, short_steps=4, long_steps=6,
            validate_every=10, device="cpu",
        ),
    )  # fmt: skip
    driven, _ = cases.simulate_test("nominal", plan.durations)
    cases.write_truth(tmp_path, "nominal", driven)
    board, without = ScoreTable(), ScoreTable()
    explained = (ALONE, NOT_ADAPTED, ORACLE_ESTIMATED)
    for variant in (CLEAN, NOISY):
        for job in (default_job, naive_job):
            outcome = job(TrainingJob("any", variant), plan, tmp_path, lambda share: None)
            for test, name, item in outcome.scores:
                board.add(variant, test, name, item)
                if name not in explained:
                    without.add(variant, test, name, item)
    table: Table = summary_table(board)
    names = [row[0] for row in table.rows]
    assert names[-4:] == [ALONE, NOT_ADAPTED, ADK_ROS, ORACLE_ESTIMATED]
    shown = dict(zip(names, table.rows, strict=True))
    # On clean tests the start is exact, so a ratio to it has no meaning.
    horizons = (len(table.header) - 1) // 2
    assert set(shown[ORACLE_ESTIMATED][1 : 1 + horizons]) == {"-"}
    assert "-" not in shown[ORACLE_ESTIMATED][1 + horizons :]
    assert not {names.index(name) for name in explained} & {row for row, _ in table.best}
    assert confirmation_criteria(board, 20) == confirmation_criteria(without, 20)
