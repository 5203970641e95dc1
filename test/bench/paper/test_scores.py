# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scores on records with known errors, and the tables of scores."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.paper import board_of, case_score, good_board, papers_board
from helpers.train import made_record

from adk_ros.bench.paper.cases import CLEAN, HISTORY, NOISY, PAPER_TESTS, rows_of
from adk_ros.bench.paper.confirmation_criteria import confirmation_criteria
from adk_ros.bench.paper.paper_results import FIVE, TABLES, effect, printed, published
from adk_ros.bench.paper.paper_tables import (
    coverage_tables,
    horizon_tables,
    number,
    one_step_tables,
)
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    ALDK,
    MF,
    NAIVE,
    ORACLE,
    PYKOOP,
    SWLS,
    NaivePredictor,
    PredictionsOnTest,
    run,
)
from adk_ros.bench.paper.ratios import geometric_means, summary_table
from adk_ros.bench.paper.scores import Combination, ScoreTable, combinations_text, score_case
from adk_ros.signals.channels import Flag, Record
from adk_ros.signals.score import DIVERGED, HORIZON_STEPS

ACCELERATION = 2.0


def ramp(n: int = 400) -> Record:
    """v_x grows by 0.05 m/s a tick; all else stays, but for a first row that is not scored."""
    x = np.zeros((n, 3))
    x[0] = 1.0
    x[:, 0] = 10.0 + ACCELERATION * 0.025 * np.arange(n)
    return replace(made_record(x), a=np.tile([ACCELERATION, 0.0], (n, 1)))


def test_scores_of_naive_predictors_are_exact() -> None:
    record = ramp()
    rows, starts = rows_of(record, 20)
    items = {
        name: score_case(record, rows, starts, run(NaivePredictor(name), record, rows, starts))
        for name in NAIVE
    }
    steps = np.array(HORIZON_STEPS)
    np.testing.assert_allclose(items["persistence"].rmse[:, 0], 0.05 * steps, rtol=1e-9)
    np.testing.assert_allclose(items["persistence"].worst[:, 0], 0.05 * steps, rtol=1e-9)
    for name in ("straight line", "IMU integration"):
        np.testing.assert_allclose(items[name].rmse, 0.0, atol=1e-10)
    count = items["persistence"].count
    assert count.tolist() == [rows.size, *[starts.size] * 4]
    assert rows.size == 400 - HISTORY - 1
    assert not items["persistence"].claimed.any()


def test_diverged_predictions_are_counted_by_horizon() -> None:
    record = ramp()
    rows, starts = rows_of(record, 20)
    passed = run(NaivePredictor("straight line"), record, rows, starts)
    ahead = passed.ahead.copy()
    ahead[2, 39:] = np.nan
    ahead[3, 79, 1] = 2e3
    item = score_case(record, rows, starts, PredictionsOnTest(passed.one, ahead))
    assert item.diverged.tolist() == [0, 0, 0, 1, 2]
    assert item.worst[4, 1] == DIVERGED
    assert item.rmse[3, 0] == pytest.approx(DIVERGED / np.sqrt(starts.size))


def test_coverage_counts_only_existing_measurements() -> None:
    record = ramp()
    rows, starts = rows_of(record, 10)
    passed = run(NaivePredictor("persistence"), record, rows, starts)
    # 90 % reach 1.645 deviations: persistence misses v_x by 0.05 m/s a step.
    variance = np.full((starts.size, 5, 3), (0.05 * 10.0 / 1.6) ** 2)
    item = score_case(record, rows, starts, replace(passed, variance=variance))
    assert item.claimed.tolist() == [[starts.size] * 3] * 5
    assert (item.covered[:, 0] > 0).tolist() == [True, True, False, False, False]
    assert (item.covered[:, 1:] == starts.size).all()
    flags = record.flags.copy()
    flags[starts[0] + 10] = int(Flag.ODOMETRY_STALE)
    item = score_case(
        replace(record, flags=flags), rows, starts, replace(passed, variance=variance)
    )
    assert item.claimed[1].tolist() == [starts.size - 1] * 3


def test_ratios_refer_to_the_best_naive_predictor() -> None:
    board = board_of({"persistence": 2.0, "straight line": 4.0, ADK_ROS: (1.0, 3.0)}, ["nominal"])
    ratios = board.ratios(ADK_ROS)
    assert len(ratios) == 2 * 5 * 3
    assert ratios[Combination(CLEAN, "nominal", 0, 0)].tolist() == [0.5, 1.5]
    assert board.rmse(NOISY, "nominal", ADK_ROS)[4, 2] == 2.0
    assert set(board.against(ADK_ROS, "straight line").values()) == {0.5}
    assert board.names() == ["persistence", "straight line", ADK_ROS]
    board.drop(ADK_ROS)
    assert not board.has(ADK_ROS)


def test_combinations_as_text() -> None:
    combos = [
        Combination(NOISY, "winter", 4, 1),
        Combination(NOISY, "winter", 0, 0),
        Combination(CLEAN, "gusts", 1, 2),
    ]
    assert (
        combinations_text(combos)
        == "clean gusts (yaw rate 0.25 s), noisy winter (v_x 1 step; v_y 2 s)"
    )


def test_published_figures_are_quoted_correctly() -> None:
    assert published(3, "nominal")["DK"][2] == (4.844, 1.552)
    assert published(4, "nominal")[ALDK][0] == (1.839, 0.220)
    assert printed("slalom", SWLS).tolist() == [0.173, 0.009, 0.080]
    assert printed("mass_minus_170", "ALDK-FFRLS", "max").tolist() == [12.13, 0.505, 49.67]
    assert effect("nominal").tolist() == [0.95, 0.91, 0.91]
    assert effect("mountain") == pytest.approx([1 - 0.044 / 1.622, 1 - 1 / 18, 1 - 7 / 83])
    for tests in TABLES.values():
        for test in tests:
            assert {test} <= set(PAPER_TESTS)
            for name in FIVE:
                assert (printed(test, name, "max") >= printed(test, name)).all()
    with pytest.raises(KeyError):
        printed("slalom", "DK")


def test_one_step_tables_compare_with_the_paper() -> None:
    tables = {table.name: table for table in one_step_tables(papers_board())}
    assert list(tables) == [f"table_{i}_clean" for i in range(3, 9)]
    five = tables["table_5_clean"]
    assert five.header[1].startswith("mass_plus_160: v_x Max/RMSE (km/h)")
    assert len(five.header) == 1 + 2 * 6
    row = next(row for row in five.rows if row[0] == SWLS)
    assert row[1:5] == ["0.495/0.088", "0.495/0.088", "0.067/0.006", "0.067/0.006"]
    for table in tables.values():
        assert {len(row) for row in table.rows} == {len(table.header)}
    # ALDK alone has figures in Table 3, and stands before those that have none.
    assert tables["table_3_clean"].rows[0][0] == ALDK
    assert next(r for r in tables["table_3_clean"].rows if r[0] == MF)[2] == "-"


def test_tables_list_all_predictors_with_the_oracle_last() -> None:
    board = good_board()
    for variant in (CLEAN, NOISY):
        for test in board.tests():
            board.add(variant, test, ORACLE, case_score(0.01))
    names = set(board.names())
    tables = one_step_tables(board) + horizon_tables(board)
    assert len(tables) == 2 * (6 + 3) + 2 * 10
    for table in tables:
        assert {row[0] for row in table.rows} == names
        assert table.rows[-1][0] == ORACLE
        assert [table.rows[i][0] for i in table.strong] == [ADK_ROS]
    assert any(table.name == "one_step_winter_noisy" for table in tables)
    summary = summary_table(board)
    ours = next(row for row in summary.rows if row[0] == ADK_ROS)
    assert ours[1:] == ["0.100"] * 10
    # Rounding over the best naive one says nothing.
    assert (CLEAN, 0) not in geometric_means(board, ORACLE)
    assert geometric_means(board, ORACLE)[NOISY, 0] == pytest.approx(0.01)


def test_means_over_fewer_tests_say_so() -> None:
    board = good_board()
    for test in board.tests()[:8]:
        board.add(NOISY, test, ORACLE, case_score(0.01))
    names = [row[0] for row in summary_table(board).rows]
    assert names[-1] == f"{ORACLE} (8 of 10 tests)"
    assert names[:-1] == board.names()[:-1]
    (noisy,) = (
        item for item in confirmation_criteria(board, 20) if item.name == "two-seconds-noisy"
    )
    assert noisy.figure.endswith("0.0100 (8 of 10 tests)")


def test_divergence_is_marked_in_tables() -> None:
    board = board_of({"persistence": 1.0}, ["slalom"])
    board.add(CLEAN, "slalom", PYKOOP, case_score(40.0, diverged=3))
    shown = next(row for row in horizon_tables(board)[0].rows if row[0] == PYKOOP)
    assert set(shown[1:]) == {"diverged (3 of 1000)"}
    shown = next(row for row in one_step_tables(board)[0].rows if row[0] == PYKOOP)
    assert shown[1] == "diverged (3 of 1000)"


def test_numbers_are_short() -> None:
    values = [1234.5, 12.34, 1.234, 0.1234, 0.01234, 1.234e-5, 0.0]
    texts = [number(value) for value in values]
    assert texts == ["1234", "12.3", "1.23", "0.123", "0.0123", "1.2e-05", "0"]


def test_table_files(tmp_path: Path) -> None:
    board = good_board(["nominal", "gusts"])
    table = one_step_tables(board)[0]
    table.write(tmp_path)
    text = (tmp_path / f"{table.name}.md").read_text()
    assert f"| **{ADK_ROS}** |" in text
    assert len(re.findall(r"^\|", text, re.M)) == len(table.rows) + 2
    with (tmp_path / f"{table.name}.csv").open() as file:
        assert list(csv.reader(file)) == [table.header, *table.rows]
    board.write_csv(tmp_path / "scores.csv")
    with (tmp_path / "scores.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 2 * 15 * (len(NAIVE) + 3 + 3)
    ours = [row for row in rows if row["predictor"] == ADK_ROS]
    assert {row["seed"] for row in ours} == {"0", "1", "2"}
    assert ours[0]["rmse_si"] == "0.09"
    assert float(ours[0]["rmse"]) == pytest.approx(0.09 * 3.6)
    assert ours[0]["coverage_90"] == "0.9000"


def test_coverage_is_pooled_over_tests_and_seeds() -> None:
    board = ScoreTable()
    for test, covered in (("nominal", 0.8), ("winter", 1.0)):
        board.add(CLEAN, test, ADK_ROS, case_score(1.0, covered=covered))
    (table,) = coverage_tables(board)
    assert [row[0] for row in table.rows] == ["nominal", "winter", "all tests"]
    assert [row[1] for row in table.rows] == ["80.0", "100.0", "90.0"]
