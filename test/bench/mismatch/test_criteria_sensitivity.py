# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sensitivity of the answers to the criteria: changed decisions, and the scores they cost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from adk_ros.bench.mismatch.case_jobs import CaseJob
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.criteria_sensitivity import (
    DOUBLE,
    HALF,
    Change,
    changes,
    check_pattern,
    sensitivity_lines,
    varied_job,
)
from adk_ros.errors import UsageError
from adk_ros.mismatch.library.criteria import MIN_GAIN, SENSOR_OFFSET_PRIORS


def answer(**criteria: tuple[int, int, int]) -> dict[str, Any]:
    return {
        "selection": {
            "criteria": {
                name: {"decisions": x[0], "changed_by_half": x[1], "changed_by_double": x[2]}
                for name, x in criteria.items()
            }
        }
    }


ANSWERS = {
    "clean": answer(MIN_GAIN=(4, 1, 0), MIN_ACTIVE_S=(1, 0, 0)),
    "drag": answer(MIN_GAIN=(6, 2, 1)),
}


def result(case: str, right: float) -> CaseResult:
    return CaseResult(case, "single", right, right, "", "")


def test_cases_are_listed_once_for_each_criterion_and_factor() -> None:
    assert changes(ANSWERS) == [
        Change("MIN_GAIN", HALF, "clean"),
        Change("MIN_GAIN", HALF, "drag"),
        Change("MIN_GAIN", DOUBLE, "drag"),
    ]


def test_a_pattern_selects_criteria() -> None:
    assert not changes(ANSWERS, "MAX_*, MIN_ACTIVE_S")
    assert len(changes(ANSWERS, "MIN_G*")) == 3


def test_a_named_criterion_of_no_recorded_decision_changes_every_case() -> None:
    assert [(x.factor, x.case) for x in changes(ANSWERS, "TOLERANCE_SIGMA")] == [
        (HALF, "clean"), (HALF, "drag"), (DOUBLE, "clean"), (DOUBLE, "drag"),
    ]  # fmt: skip
    assert not changes(ANSWERS, "TOLERANCE_*")  # Not named: 43 criteria would be tried.


def test_a_misspelt_criterion_is_refused_with_the_nearest() -> None:
    check_pattern("MIN_GAIN, FEATURE_*")
    with pytest.raises(UsageError, match="no criterion is named TOLERANCE_SIGM: did you mean TOL"):
        check_pattern("MIN_GAIN,TOLERANCE_SIGM")


def test_lines_state_what_a_criterion_of_no_recorded_decision_changes() -> None:
    results = [result("clean", 1.0), result("drag", 0.5)]
    varied = {Change("SETTLING_S", HALF, x.case): x.right for x in results}
    assert sensitivity_lines(results, ANSWERS, varied)[0] == (
        "SETTLING_S, in no recorded decision: 0.5 times gives 1.5 -> 1.5 right of 2"
    )


def test_all_values_of_a_group_are_multiplied() -> None:
    code = (
        "from adk_ros.cli.varied_command import multiply; multiply('SENSOR_OFFSET_PRIORS', 2.0); "
        "from adk_ros.mismatch.library.criteria import SENSOR_OFFSET_PRIORS as x; "
        "print(x['bias_gyro'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    expected = tuple(2.0 * x for x in SENSOR_OFFSET_PRIORS["bias_gyro"])
    assert done.stdout.strip() == str(expected)


def test_a_changed_case_is_analysed_under_its_own_name_and_key() -> None:
    job = CaseJob("drag", "key", lambda folder: folder)
    varied = [varied_job(Change("MIN_GAIN", factor, "drag"), job) for factor in (HALF, DOUBLE)]
    assert [x.factors for x in varied] == [{"MIN_GAIN": 0.5}, {"MIN_GAIN": 2.0}]
    assert len({x.key for x in [job, *varied]}) == len({x.name for x in [job, *varied]}) == 3


def test_the_new_value_holds_wherever_the_criterion_is_used() -> None:
    """The watch's alarm threshold is `MIN_GAIN` under another name."""
    code = (
        "from adk_ros.cli.varied_command import multiply; multiply('MIN_GAIN', 0.5); "
        "from adk_ros.mismatch.watch.settings import ALARM_THRESHOLD; print(ALARM_THRESHOLD)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) == 0.5 * MIN_GAIN


def test_lines_state_what_another_value_costs() -> None:
    results = [result("clean", 1.0), result("drag", 0.5)]
    varied = {
        Change("MIN_GAIN", HALF, "clean"): 0.0,
        Change("MIN_GAIN", HALF, "drag"): 0.5,
        Change("MIN_GAIN", DOUBLE, "drag"): 0.75,
    }
    assert sensitivity_lines(results, ANSWERS, varied) == [
        "MIN_ACTIVE_S decides in 1 of 2 cases; halved: a decision changes in 0; doubled: a "
        "decision changes in 0",
        "MIN_GAIN decides in 2 of 2 cases; halved: a decision changes in 2, -1.00 right in 2 of "
        "them; doubled: a decision changes in 1, +0.25 right in 1 of them",
    ]


def test_command_takes_a_criterion_and_a_factor(tmp_path: Path) -> None:
    """Usage errors of the command itself pass through."""
    done = subprocess.run(
        [
            sys.executable, "-m", "adk_ros.cli.varied_command", "MIN_GAIN=0.5",
            "mismatch", "--simulation", str(tmp_path / "absent"), "--recording", str(tmp_path),
            "--out", str(tmp_path / "out"),
        ],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "not a rosbag2 folder" in done.stderr
    assert "Traceback" not in done.stderr
