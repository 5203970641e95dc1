# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark page: self-contained, with contents and provenance, result first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.pages import (
    PROVENANCE,
    Page,
    assert_contents,
    assert_provenance,
    assert_self_contained,
)
from helpers.paper import case_score, good_board

from adk_ros.bench.paper.av21 import RecordingScores
from adk_ros.bench.paper.cases import CLEAN, NOISY
from adk_ros.bench.paper.criterion import FAIL, PASS
from adk_ros.bench.paper.paper_bench import Result
from adk_ros.bench.paper.paper_page import PaperReport, write_report
from adk_ros.bench.paper.predictors import ADK_ROS, ORACLE
from adk_ros.bench.paper.training_jobs import BenchPlan


def recorded() -> RecordingScores:
    table = np.full((5, 3), 0.8)
    rmse = {"persistence": np.ones((5, 3)), ADK_ROS: table}
    return RecordingScores({"<b> / <b>": table}, {"<b> / <b>": rmse})


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[PaperReport, Page]:
    base = tmp_path_factory.mktemp("paper")
    board = good_board()
    for variant in (CLEAN, NOISY):
        for test in board.tests():
            board.add(variant, test, ORACLE, case_score(0.01))
    result = Result(board, recorded(), [], "switched off", 90.0, {"DK": "a <setting>"})
    (base / "out").mkdir()
    (base / "out" / "bars.txt").write_text("of 0.1.0\n")
    report = write_report(result, BenchPlan(), base, base / "out", provenance=PROVENANCE)
    return report, Page(report.page.read_text(encoding="utf-8"))


def test_the_page_is_self_contained_with_contents(written: tuple[PaperReport, Page]) -> None:
    _, page = written
    assert_self_contained(page)
    assert_contents(page)
    assert_provenance(page)
    assert [alt for alt, _ in page.images] == [
        "Summary: RMSE divided by that of the best naive predictor, by horizon"
    ]
    for heading in ("Result", "Definitions and settings", "Acceptance criteria",
                    "Recordings of a real car", "Claims of the paper"):  # fmt: skip
        assert heading in page.headings.values()


def test_the_result_comes_first(written: tuple[PaperReport, Page]) -> None:
    report, page = written
    passed = sum(item.verdict == PASS for item in report.criteria)
    failed = sum(item.verdict == FAIL for item in report.criteria)
    lead = page.text.index("adk_ros has the lowest mean error of ")
    assert lead < page.text.index("This page reproduces Tables 3 to 8")
    assert "in 10 of 10 columns (a horizon of a variant) below" in page.text
    assert f"meets {passed} of {passed + failed} acceptance criteria." in page.text


def test_the_criteria_replace_those_of_an_earlier_report(
    written: tuple[PaperReport, Page],
) -> None:
    report, _ = written
    lines = (report.page.parent / "criteria.txt").read_text().splitlines()
    assert lines == [str(criterion) for criterion in report.criteria]
    assert not (report.page.parent / "bars.txt").exists()


def test_names_are_escaped(written: tuple[PaperReport, Page]) -> None:
    _, page = written
    assert "Trained on the first 60 % of <b>" in page.text
    assert "a <setting>" in page.text
    assert "b" not in page.tags


def test_a_page_without_provenance_is_the_same_file_each_time(tmp_path: Path) -> None:
    result = Result(good_board(), None, [], "", 90.0)
    pages = [
        write_report(result, BenchPlan(), tmp_path, tmp_path / name).page.read_bytes()
        for name in ("first", "second")
    ]
    assert pages[0] == pages[1]
    assert b"Not recorded." in pages[0]
