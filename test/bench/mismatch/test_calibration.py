# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration of the held-out criteria: its cases, and quantiles over correct results."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from adk_ros.bench.mismatch.calibration import FIRST_SEED, calibrate, calibration_plans
from adk_ros.bench.mismatch.case_matrix import case_plans
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.mismatch_bench import code_digest, plan_jobs
from adk_ros.mismatch.library.criteria import INEXACT_EQUATION_SHARE, MAX_EXPLAINED_RATIO


def test_its_cases_are_not_those_of_the_benchmark() -> None:
    plans = calibration_plans(40)
    assert len({plan.name for plan in plans}) == 40
    assert sum(not plan.injected.effects for plan in plans) == 20
    assert len({plan.plant for plan in plans}) > 1
    seeds = {plan.seed for plan in plans}
    assert min(seeds) == FIRST_SEED
    assert not seeds & {plan.seed for plan in case_plans()}


def result(name: str, kind: str, right: float = 1.0) -> CaseResult:
    return CaseResult(name, kind, right, right, "", "")


def report(out: Path, name: str, before: float, corrected: float, expected: float) -> None:
    limit = float(np.hypot(MAX_EXPLAINED_RATIO * expected, INEXACT_EQUATION_SHARE * before))
    errors = {
        "before": {"v_x": before, "v_y": None, "yaw_rate": before},
        "expected": {"v_x": expected, "v_y": expected, "yaw_rate": expected},
        "ratio": {"v_x": corrected / limit, "v_y": None, "yaw_rate": 0.0},
    }
    (out / name).mkdir()
    content = {"fit": {"horizons": {"1": errors}}}
    (out / name / "mismatch.json").write_text(json.dumps(content))


def test_quantiles_are_those_of_correct_results(tmp_path: Path) -> None:
    report(tmp_path, "clean_a", 0.02, 0.018, 0.02)
    report(tmp_path, "clean_b", 0.02, 0.024, 0.02)
    report(tmp_path, "drag", 0.5, 0.05, 0.02)
    report(tmp_path, "wrong", 0.5, 0.5, 0.02)
    results = [
        result("clean_a", "none"), result("clean_b", "none"), result("drag", "single"),
        result("wrong", "single", 0.0),
    ]  # fmt: skip
    ratio, share = calibrate(results, tmp_path)
    assert (ratio.cases, share.cases) == (2, 1)
    assert ratio.largest == pytest.approx(1.2)
    left = np.sqrt(0.05**2 - (MAX_EXPLAINED_RATIO * 0.02) ** 2) / 0.5
    assert share.largest == pytest.approx(left)
    assert "2 correct results are below 1.2, the largest is 1.2" in str(ratio)


def test_results_of_other_code_are_not_resumed(monkeypatch: pytest.MonkeyPatch) -> None:
    plans = calibration_plans(2)
    before = [job.key for job in plan_jobs(plans)]
    assert len(set(before)) == 2
    assert before == [job.key for job in plan_jobs(plans)]
    assert len(code_digest()) == 64
    monkeypatch.setattr("adk_ros.bench.mismatch.mismatch_bench.code_digest", lambda: "other")
    assert not set(before) & {job.key for job in plan_jobs(plans)}
