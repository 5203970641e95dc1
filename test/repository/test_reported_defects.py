# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each reported defect of `adk mismatch` has a test."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import pytest
from reported_defects import DEFECTS, Answer

ROOT = Path(__file__).parents[2]
TESTS, ANSWERS = (
    (ROOT / "doc" / "reported-defects.md")
    .read_text(encoding="utf-8")
    .split("## The same recordings", 1)
)
ROWS, ANSWER_ROWS = (
    [
        line
        for line in text.splitlines()
        if line.startswith("| ") and not line.startswith(("| seen", "| ---"))
    ]
    for text in (TESTS, ANSWERS)
)


def test_all_defects_are_listed() -> None:
    assert len(ROWS) >= 13


@pytest.mark.parametrize("row", ROWS)
def test_a_defect_names_tests_that_exist(row: str) -> None:
    named = re.findall(r"`(test/[\w/]+\.py)::(\w+)`", row)
    assert named, row
    for path, name in named:
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        defined = {x.name for x in tree.body if isinstance(x, ast.FunctionDef)}
        assert name in defined, f"{path}::{name}"


def test_the_answers_of_both_checkouts_are_of_the_defects_of_the_script() -> None:
    cells = [row.strip("| ").split(" | ") for row in ANSWER_ROWS]
    assert [seen for seen, _, _ in cells] == [defect.seen for defect in DEFECTS]
    assert all(now.startswith("right: ") for _, _, now in cells)
    wrong = sum(first.startswith("wrong: ") for _, first, _ in cells)
    assert f"Of the {len(cells)} answers {wrong} are wrong at 8313453" in ANSWERS
    assert f"and all are right at {cells_commit()}" in ANSWERS


def cells_commit() -> str:
    """Return the commit of the last column."""
    (head,) = (line for line in ANSWERS.splitlines() if line.startswith("| seen"))
    return head.strip("| ").rsplit(" ", 1)[1]


def answer(code: int = 0, message: str = "", **result: Any) -> Answer:
    return Answer(code, message, {"effects": [], **result})


def judge(name: str, given: Answer) -> bool:
    (defect,) = (x for x in DEFECTS if x.name == name)
    return defect.is_right(given)


def test_an_answer_is_judged_by_what_it_says() -> None:
    fit = {"before": {"v_x": 0.1, "v_y": 0.2}, "after": {"v_x": 0.05, "v_y": 0.201}}
    oscillates = {"text": "a moment that oscillates in time at 0.28 Hz"}
    unknown = answer(verdict="unknown", unexplained=oscillates, fit=fit)
    assert judge("oscillating_yaw_moment", unknown)
    raised = {**fit, "after": {"v_x": 0.05, "v_y": 0.205}}
    assert not judge("oscillating_yaw_moment", answer(**{**unknown.result, "fit": raised}))
    assert not judge("oscillating_yaw_moment", answer(**{**unknown.result, "verdict": "none"}))
    ratio = {
        "name": "steering_ratio",
        "confidence": 0.97,
        "alternatives": [],
        "parameters": {"scale": {"value": 0.931}},
    }
    assert judge("foreign_steering", answer(verdict="explained", effects=[ratio]))
    far = {**ratio, "parameters": {"scale": {"value": 0.95}}}
    assert not judge("foreign_steering", answer(verdict="explained", effects=[far]))
    assert judge("heavy_vehicle_file", answer(3, "the torque response implies a mass of 2039 kg"))
    assert not judge("heavy_vehicle_file", answer(verdict="none"))
