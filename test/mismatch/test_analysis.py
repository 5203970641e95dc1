# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The whole way: from two drives of a plant that shares no code with the stand-in to an answer."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.mismatch import case

from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.deployment.open_loop import OpenLoopPredictor, horizon_rmse, start_times_of
from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.report.result_files import as_dict, write_report
from adk_ros.mismatch.report.summary import sentence

DRAG = 1.0


@cache
def drag() -> MismatchResult:
    c = case("aero_drag", cda=DRAG)
    return identify_mismatch(c.simulation, c.recording, c.nominal)


def test_nothing_is_found_where_nothing_is() -> None:
    c = case()
    findings = identify_mismatch(c.simulation, c.recording, c.nominal)
    assert findings.verdict == "none"
    assert findings.effects == []
    assert "No significant mismatch" in sentence(findings)
    answer = as_dict(findings)
    assert answer["verdict"] == "none"
    assert answer["effects"] == []


def test_drag_is_named_and_measured() -> None:
    findings = drag()
    assert findings.verdict == "explained"
    (effect,) = findings.effects
    assert effect.effect.name == "aero_drag"
    value = effect.parameters["cda"]
    assert value.value == pytest.approx(DRAG, rel=0.05)
    assert value.low < value.value < value.high
    assert findings.after["v_x"] < 0.3 * findings.before["v_x"]
    assert "m² more drag area (C_dA) than the simulation" in sentence(findings)


def test_the_report_holds_the_answer_and_both_models(tmp_path: Path) -> None:
    write_report(drag(), tmp_path / "report")
    assert not (tmp_path / "report.part").exists()
    answer = json.loads((tmp_path / "report" / "mismatch.json").read_text())
    assert answer["schema"] == 1
    assert answer["effects"][0]["where"]["kind"] == "always"
    assert set(answer["fit"]["before"]) == {"v_x", "v_y", "yaw_rate"}
    corrected = yaml.safe_load((tmp_path / "report" / "corrected.yaml").read_text())
    assert [term["effect"] for term in corrected["terms"]] == ["aero_drag"]
    assert "terms" not in yaml.safe_load((tmp_path / "report" / "simulation.yaml").read_text())
    # Written again over itself.
    write_report(drag(), tmp_path / "report")


def test_the_corrected_model_predicts_the_held_out_drive(tmp_path: Path) -> None:
    write_report(drag(), tmp_path / "report")
    heldout = case("aero_drag", cda=DRAG).heldout
    before, after = (
        horizon_rmse(load_surrogate(tmp_path / "report" / name).content, heldout, 1.0, 2.0)
        for name in ("simulation.yaml", "corrected.yaml")
    )
    assert after[0] < 0.3 * before[0]
    assert np.all(after < 1.1 * before)


def test_a_prediction_uses_nothing_after_its_start(tmp_path: Path) -> None:
    write_report(drag(), tmp_path / "report")
    model = load_surrogate(tmp_path / "report" / "corrected.yaml").content
    whole = case("aero_drag", cda=DRAG).heldout
    starts = np.array([4.0, 5.0])
    known = OpenLoopPredictor(model, whole).predict(starts, 40)
    cut = whole.between(0.0, 5.0 + 1e-9)
    # The commands stay known.
    cut = type(whole)(
        cut.name,
        whole.duration_s,
        cut.imu_s,
        cut.imu,
        cut.odometry_s,
        cut.odometry,
        cut.pose,
        whole.command_s,
        whole.command,
    )
    np.testing.assert_array_equal(OpenLoopPredictor(model, cut).predict(starts, 40), known)


def test_starts_are_on_the_grid_of_ticks() -> None:
    starts = start_times_of(case().heldout, 40, 0.5, 2.0)
    np.testing.assert_allclose(starts, 2.0 + 0.5 * np.arange(starts.size), atol=1e-9)
    assert starts[-1] + 1.0 <= 30.1
