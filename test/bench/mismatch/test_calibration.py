# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration: its cases, quantiles over correct results, and the confidence."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adk_ros.bench.mismatch.calibration import calibrate, systematic_share
from adk_ros.bench.mismatch.calibration_cases import FIRST_SEED, calibration_plans
from adk_ros.bench.mismatch.case_jobs import plan_jobs
from adk_ros.bench.mismatch.case_matrix import case_plans
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.confidence_fit import (
    Claim,
    fit_confidence,
    probabilities,
    stated,
)
from adk_ros.bench.mismatch.reliability import brier_score
from adk_ros.bench.vehicles.multibody import MULTI_BODY
from adk_ros.files.code_digest import code_digest
from adk_ros.mismatch.inference.confidence import ConfidenceModel, Evidence
from adk_ros.mismatch.library.criteria import INEXACT_EQUATION_SHARE, MAX_EXPLAINED_RATIO
from adk_ros.plant.injection.injected_drive import PLANTS


def test_its_cases_are_not_those_of_the_benchmark() -> None:
    plans = calibration_plans(80)
    assert len({plan.name for plan in plans}) == 80
    unlisted = sum(bool(plan.injected.unlisted) for plan in plans)
    clean = sum(not plan.injected.effects and not plan.injected.unlisted for plan in plans)
    assert (clean, unlisted) == (20, 20)
    assert {plan.plant for plan in plans} == {*PLANTS, MULTI_BODY}
    assert sum(plan.plant == MULTI_BODY for plan in plans) == 20
    assert len({plan.strength for plan in plans}) == 80
    seeds = {plan.seed for plan in plans}
    assert min(seeds) == FIRST_SEED
    assert not seeds & {plan.seed for plan in case_plans()}


def result(name: str, kind: str, right: float = 1.0) -> CaseResult:
    return CaseResult(name, kind, right, right, "", "")


def claim(margin: float, value: float) -> dict[str, Any]:
    """Return a reported drag whose absence is worse by `margin` in each of twelve blocks."""
    losses = {"prior_cost": 0.0, "block_losses": [margin] * 12}
    alternatives = [{"name": "none", "log_prior": 0.0, **losses}]
    return {
        "name": "aero_drag",
        "alternatives": [],
        "parameters": {"cda": {"value": value, "low": value - 0.05, "high": value + 0.05}},
        "evidence": {
            "surrogate_error": 0.0,
            "alternatives": alternatives,
        },
    }


def report(
    out: Path,
    name: str,
    corrected: float,
    effects: Sequence[dict[str, Any]] = (),
    true: float | None = None,
    before: float = 0.02,
) -> None:
    expected = 0.02
    limit = float(np.hypot(MAX_EXPLAINED_RATIO * expected, INEXACT_EQUATION_SHARE * before))
    errors = {
        "before": {"v_x": before, "v_y": None, "yaw_rate": before},
        "expected": {"v_x": expected, "v_y": expected, "yaw_rate": expected},
        "ratio": {"v_x": corrected / limit, "v_y": None, "yaw_rate": 0.0},
    }
    label = [] if true is None else [{"name": "aero_drag", "params": {"cda": true}}]
    content = {
        "verdict": "explained" if effects else "none",
        "effects": list(effects),
        "selection": {
            "expected_loss": 1000.0,
            "surrogate_error": 100.0,
            "surrogate_variance_share": 0.11,
            "steps": [
                {"effects": [], "loss": 1100.0, "gain": 0.0, "required": 0.0},
                {"effects": ["aero_drag"], "loss": 1080.0, "gain": 20.0, "required": 50.0},
            ],
        },
        "fit": {"horizons": {"1": errors}},
    }
    (out / name).mkdir()
    (out / name / "mismatch.json").write_text(json.dumps(content))
    (out / name / "score.json").write_text(json.dumps({"label": {"effects": label}}))


def test_criteria_are_calibrated_on_correct_results(tmp_path: Path) -> None:
    report(tmp_path, "clean_a", 0.018)
    report(tmp_path, "clean_b", 0.024)
    report(tmp_path, "drag", 0.05, [claim(50.0, 1.0)], 1.04, before=0.5)
    report(tmp_path, "wrong", 0.5, [claim(1.0, 1.0)], before=0.5)
    results = [
        result("clean_a", "none"), result("clean_b", "none"), result("drag", "single"),
        result("wrong", "single", 0.0),
    ]  # fmt: skip
    ratio, share, gain, *selection, interval, foreign, confidence = calibrate(results, tmp_path)
    assert selection == [
        "required gain: 95 % of 3 absent effects stay below 0.4 of it, "
        "95 % of 1 present ones exceed 0.4",
        "explained excess loss: 95 % of 4 complete results stay below 2.5 of it, "
        "no best ones without what is not listed",
    ]
    assert "2 correct results are below 1.2, the largest is 1.2" in ratio
    left = np.sqrt(0.05**2 - (MAX_EXPLAINED_RATIO * 0.02) ** 2) / 0.5
    assert f"the largest is {left:.3g}" in share
    assert "at most 0.40 of what is required on 2 clean cases" in gain
    assert "false alarms 0" in gain
    assert "1 of 1 intervals hold; 90 % with a share of 0.0" in interval
    assert "where the surrogate error is more than 0.1 of the variance: 1 of 1" in foreign
    assert confidence == "confidence: 2 claims, 1 of them right: not enough to calibrate"


def test_systematic_share_is_the_least_that_covers() -> None:
    rng = np.random.default_rng(1)
    size = np.full(4000, 2.0)
    error = np.abs(rng.normal(0.0, np.hypot(0.01, 0.03 * size)))
    share = systematic_share([(e, s, 0.01) for e, s in zip(error, size, strict=True)])
    assert share == pytest.approx(0.03, rel=0.05)


def test_confidence_is_fitted_to_claims_right_and_wrong() -> None:
    """Wrong claims with large held-out errors, and small ones next to a large effect."""
    rng = np.random.default_rng(2)

    def made(right: bool, margin: float, total: float, ratio: float) -> Claim:
        differences = (margin / 16) * (1.0 + 0.1 * rng.normal(size=(1, 16)))
        return Claim(Evidence(("none",), differences, np.zeros(1), total), ratio, right)

    claims = [made(True, 2000.0, 2000.0, 0.3) for _ in range(60)]
    claims += [made(False, 150.0, 60_000.0, 0.4) for _ in range(8)]
    claims += [made(False, 9000.0, 9000.0, 2.5) for _ in range(8)]
    model = fit_confidence(claims)
    p = probabilities(model, claims)
    assert p[:60].min() > 0.9
    assert p[60:].mean() < 0.6
    worse = stated(ConfidenceModel(1e-6, 1e-3, 0.1), claims)
    assert brier_score(stated(model, claims)) < brier_score(worse)


def test_results_of_other_code_are_not_resumed(monkeypatch: pytest.MonkeyPatch) -> None:
    plans = calibration_plans(2)
    before = [job.key for job in plan_jobs(plans)]
    assert len(set(before)) == 2
    assert before == [job.key for job in plan_jobs(plans)]
    assert len(code_digest()) == 64
    monkeypatch.setattr("adk_ros.bench.mismatch.case_jobs.code_digest", lambda: "other")
    assert not set(before) & {job.key for job in plan_jobs(plans)}
