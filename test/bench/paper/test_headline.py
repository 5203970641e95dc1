# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The headline and the oracle: bold cells, lower bounds, explanations of failed criteria."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from helpers.paper import board_of, case_score, good_board, papers_board

from adk_ros.bench.paper import oracle_notes
from adk_ros.bench.paper.av21 import RecordingScores
from adk_ros.bench.paper.cases import CLEAN, NOISY, TESTS
from adk_ros.bench.paper.criteria import brief, evaluate_paper_criteria
from adk_ros.bench.paper.criterion import FAIL
from adk_ros.bench.paper.failure_analysis import explain_failures
from adk_ros.bench.paper.headline import headline
from adk_ros.bench.paper.paper_figures import summary_figure
from adk_ros.bench.paper.paper_tables import horizon_tables, recording_tables
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    MF,
    MF_CHOSEN,
    MF_PLAIN,
    MF_TUNED,
    NAIVE,
    ORACLE,
    PYKOOP,
    PYKOOPMAN,
)
from adk_ros.bench.paper.ratios import best_cells, ratio_tables, summary_table
from adk_ros.bench.paper.scores import Combination, ScoreTable

NAIVES = {name: 1.0 for name in NAIVE}


def with_oracle(board: ScoreTable, rmse: float, variant: str = NOISY) -> ScoreTable:
    for test in board.tests():
        board.add(variant, test, ORACLE, case_score(rmse))
    return board


def test_headline_rows_and_bold_cells(tmp_path: Path) -> None:
    board = with_oracle(with_oracle(good_board(), 0.01), 1e-14, CLEAN)
    board.scores[NOISY, "slalom", PYKOOP] = [case_score(0.5, diverged=3)]
    made = headline(board, "One seed.")
    made.write(tmp_path)
    text = (tmp_path / "headline.md").read_text()
    assert "10 tests" in text
    assert text.split("\n")[0].endswith("One seed.")
    rows = re.findall(r"^\| (.*) \|$", text, re.M)
    assert rows.count(" | ".join(["**adk_ros**", *["**0.100**"] * 5])) == 2
    assert "oracle (the plant) | exact | exact | exact | exact | exact" in rows
    assert "oracle (the plant) | 0.0100 | 0.0100 | 0.0100 | 0.0100 | 0.0100" in rows
    assert "pykoop | > 0.500 (1) | > 0.500 (1) | > 0.500 (1) | > 0.500 (1) | > 0.500 (1)" in rows
    with (tmp_path / "headline.csv").open() as file:
        stored = list(csv.DictReader(file))
    ours = [row for row in stored if row["predictor"] == ADK_ROS]
    assert [row["1 step"] for row in ours] == ["0.1", "0.1"]
    koop = next(r for r in stored if r["predictor"] == PYKOOP and r["variant"] == NOISY)
    assert koop["tests diverged 2 s"] == "1"


def test_each_parameter_choice_of_the_physics_model_is_a_row() -> None:
    rmse = {MF_PLAIN: 0.8, MF: 0.7, MF_TUNED: 0.6, MF_CHOSEN: 0.6}
    made = headline(board_of(NAIVES | rmse | {ADK_ROS: 0.1}))
    for table in made.tables:
        rows = {row[0]: row[1] for row in table.rows}
        assert {name: rows[name] for name in rmse} == {
            MF_PLAIN: "0.800", MF: "0.700", MF_TUNED: "0.600", MF_CHOSEN: "0.600",
        }  # fmt: skip


def test_baseline_libraries_that_did_not_run_are_listed() -> None:
    made = headline(board_of(NAIVES | {ADK_ROS: 0.1}))
    assert made.tables[0].rows[-2] == [PYKOOPMAN, *["not run"] * 5]


def test_neither_ratios_above_one_nor_bounds_are_bold() -> None:
    board = with_oracle(board_of(NAIVES | {ADK_ROS: 1.5, MF_TUNED: 1.2}), 0.01)
    for table in (*headline(board).tables, summary_table(board)):
        assert table.best == frozenset()
        assert "**1.5" not in table.markdown()
        assert f"**{ADK_ROS}**" in table.markdown()
    for table in horizon_tables(board):
        row = next(r for r in table.markdown().split("\n") if f"**{ADK_ROS}**" in r)
        assert row.count("**") == 2
    names = [PYKOOP, ADK_ROS, ORACLE]
    assert best_cells(names, [{ADK_ROS: 0.5, ORACLE: 0.1}, {PYKOOP: 0.2, ADK_ROS: 0.5}, {}]) == {
        (1, 1), (0, 2),
    }  # fmt: skip
    assert not any(table.strong or table.best for table in ratio_tables(board))


def test_every_ratio_of_adk_ros_is_in_a_table() -> None:
    clean, noisy = ratio_tables(board_of(NAIVES | {ADK_ROS: (0.1, 0.3)}))
    assert [row[0] for row in noisy.rows] == list(TESTS)
    assert clean.rows[0][1:] == ["0.2"] * 15


@pytest.mark.parametrize(("floor", "expected"), [(0.5, False), (0.96, False), (0.98, True)])
def test_at_the_oracle_within_three_percent(floor: float, expected: bool) -> None:
    board = with_oracle(with_oracle(board_of(NAIVES | {ADK_ROS: 1.0}), floor), floor, CLEAN)
    noisy, clean = Combination(NOISY, "winter", 0, 1), Combination(CLEAN, "winter", 0, 1)
    assert oracle_notes.at_oracle(board, [noisy, clean]) == ({noisy} if expected else set())
    assert oracle_notes.over_oracle(board, noisy) == pytest.approx(1.0 / floor)
    assert np.isnan(oracle_notes.over_oracle(board, clean))


def test_criteria_mark_combinations_at_the_oracle_and_count_them() -> None:
    board = with_oracle(board_of(NAIVES | {ADK_ROS: 1.005, MF_TUNED: 0.9}, ["winter"]), 1.0)
    found = {criterion.name: criterion for criterion in evaluate_paper_criteria(board, None)}
    above = found["no-combination-above-1"]
    assert above.verdict == FAIL
    assert above.figure.startswith(
        "30 of 30 combinations exceed 1.0 in all seeds (15 of them at the oracle, where the plant "
    )
    assert "clean winter (v_x 1 step 1.005;" in above.figure
    assert "noisy winter (v_x 1 step 1.005 at the oracle;" in above.figure
    figure = found["ahead-of-tuned-7dof"].figure
    assert figure.startswith(
        "0.0 % of 30 combinations, at least 90 %; behind in 30 (15 of them at the"
    )
    assert brief(figure).endswith("is no better)")


def test_long_lists_are_cut_from_the_text_of_a_criterion() -> None:
    listed = ", ".join(f"clean winter (v_x {i} s 2.0)" for i in range(20))
    assert brief(f"8 of 9 within; outside: {listed}") == "8 of 9 within"
    assert brief(f"4 of 9 pairs; behind in 5: {listed}") == "4 of 9 pairs; behind in 5"
    assert brief(f"5 pairs, all above 1.0: {listed}") == "5 pairs, all above 1.0"
    for short in ("not measured: give --recordings DIR", "0.1 of 300 pairs"):
        assert brief(short) == short


def test_the_cause_of_a_leading_baseline_is_explained() -> None:
    board = with_oracle(good_board(), 0.0999)
    for test in TESTS[:5]:
        board.scores[NOISY, test, PYKOOP] = [case_score(0.05)]
    board.scores[NOISY, "slalom", PYKOOP] = [case_score(0.5, diverged=7)]
    judged = evaluate_paper_criteria(board, None)
    said = explain_failures(board, None, judged)
    assert set(said) == {criterion.name for criterion in judged if criterion.verdict == FAIL} - {
        "av21", "papers-effect"
    }  # fmt: skip
    text = said["ahead-of-pykoop"]
    for part in (
        "pykoop leads in 75 combinations: noisy 75 of 150; by horizon 1 step 15 of 60",
        "in 75 of 150 combinations, on other roads, grip, wind or tyres in 0 of 150 combinations: "
        "mainly in distribution",
        "It diverges in 1 of the 20 clean and noisy tests: noisy slalom (7 of 1000 at 1 step)",
        "1.00 times that of the oracle in the median",
        "in 75 of 75 it is at the oracle",
        "In 75 of these pykoop is better than the oracle",
        "adk_ros 0.36, pykoop 0.18, persistence 3.60, oracle 0.36, sensor noise 0.072 km/h",
    ):
        assert part in text, part


def test_the_cause_of_a_high_mean_and_of_ratios_above_one_is_explained() -> None:
    board = with_oracle(board_of(NAIVES | {ADK_ROS: 0.5}), 0.3)
    board.scores[CLEAN, "gusts", ADK_ROS] = [case_score(1.5)]
    board.scores[NOISY, "winter", ADK_ROS] = [case_score(0.004)]
    said = explain_failures(board, None, evaluate_paper_criteria(board, None))
    assert "highest in gusts (0.866)" in said["geometric-mean"]
    assert "started from the same sample) is 0.3 at 1 step" in said["geometric-mean"]
    above = said["no-combination-above-1"]
    assert above.startswith("A naive predictor wins in 15 combinations: clean 15 of 150;")
    assert "On clean tests the oracle is exact" in above
    assert "clean gusts v_x 1 step, ratio 1.50 (adk_ros 5.40, persistence 3.60 km/h)" in above


def test_the_cause_of_low_coverage_and_effect_is_explained() -> None:
    board = good_board()
    for test in TESTS:
        board.scores[CLEAN, test, ADK_ROS] = [case_score(0.1, covered=0.8)]
    text = explain_failures(board, None, evaluate_paper_criteria(board, None))["coverage"]
    assert "clean v_x at 1 step: the intervals are too narrow, coverage 80.0 %" in text
    board = papers_board()
    for (_, test, name), items in board.scores.items():
        if name == "ALDK-SWLS" and test != "nominal":
            items[0] = case_score(2.0 * items[0].rmse)
    for test in board.tests():
        for name in (*NAIVE, ADK_ROS):
            board.add(CLEAN, test, name, case_score(1.0))
    text = explain_failures(board, None, evaluate_paper_criteria(board, None))["papers-effect"]
    assert "In 0 of the 18 entries" in text
    assert "2.00 times the paper's RMSE in the median" in text
    assert "less accurate than in the paper in 18." in text


def test_recordings_have_a_table_and_an_explanation() -> None:
    ours, naive = np.full((5, 3), 1.2), np.ones((5, 3))
    rmse = {"persistence": naive, "straight line": 2.0 * naive, ADK_ROS: ours}
    recorded = RecordingScores({"a / a": ours, "a / b": ours}, {"a / a": rmse, "a / b": rmse})
    first, second = recording_tables(recorded)
    assert first.title == (
        "Trained on the first 60 % of a, tested on the remaining 40 %, future commands known"
    )
    assert "tested on all of b" in second.title
    assert [row[0] for row in first.rows] == [
        "persistence", "straight line", ADK_ROS, f"{ADK_ROS} / best naive",
    ]  # fmt: skip
    assert first.rows[0][1] == "3.60"
    assert first.rows[-1][1:] == ["1.20"] * 15
    board = good_board()
    text = explain_failures(board, recorded, evaluate_paper_criteria(board, recorded))["av21"]
    assert text.startswith("a, v_x at 0.5 s: adk_ros 4.32, persistence 3.60 km/h; one step ahead")


def test_the_figure_is_drawn_for_all_and_for_few_scores(tmp_path: Path) -> None:
    for name, board in (("all", with_oracle(good_board(), 1e-5)), ("one", board_of(NAIVES | {
        ADK_ROS: 1e6,
    }, ["nominal"], [CLEAN]))):  # fmt: skip
        path = tmp_path / f"{name}.png"
        summary_figure(board, path)
        assert path.read_bytes().startswith(b"\x89PNG")
