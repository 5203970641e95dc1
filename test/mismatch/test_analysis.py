# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mismatch analysis on recordings of a plant that shares no code with the surrogate."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.mismatch import case

from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.deployment.held_out import Evidence, horizon_errors, rmse
from adk_ros.mismatch.deployment.open_loop import OpenLoopPredictor
from adk_ros.mismatch.deployment.prediction_starts import start_times_of
from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.report.result_files import as_dict, write_report
from adk_ros.mismatch.report.summary import sentence

pytestmark = pytest.mark.usefixtures("unrendered")

DRAG = 1.0


@cache
def drag() -> MismatchResult:
    c = case("aero_drag", cda=DRAG)
    return identify_mismatch(c.simulation, c.recording, c.nominal)


def test_no_effect_in_a_clean_case() -> None:
    c = case()
    result = identify_mismatch(c.simulation, c.recording, c.nominal)
    assert result.verdict == "none"
    assert result.effects == []
    assert "No significant mismatch" in sentence(result)
    answer = as_dict(result)
    assert answer["verdict"] == "none"
    assert answer["effects"] == []


def test_drag_is_identified() -> None:
    result = drag()
    assert result.verdict == "explained"
    (effect,) = result.effects
    assert effect.effect.name == "aero_drag"
    value = effect.parameters["cda"]
    assert value.value == pytest.approx(DRAG, rel=0.05)
    assert value.low < value.value < value.high
    assert result.after["v_x"] < 0.3 * result.before["v_x"]
    assert "m² more drag area (C_dA) than the simulation" in sentence(result)


def test_report_contains_the_result_and_both_models(tmp_path: Path) -> None:
    write_report(drag(), tmp_path / "report")
    assert not (tmp_path / "report.part").exists()
    answer = json.loads((tmp_path / "report" / "mismatch.json").read_text())
    assert answer["schema"] == 2
    assert answer["effects"][0]["where"]["kind"] == "always"
    assert set(answer["fit"]["before"]) == {"v_x", "v_y", "yaw_rate"}
    corrected = yaml.safe_load((tmp_path / "report" / "corrected.yaml").read_text())
    assert [term["effect"] for term in corrected["terms"]] == ["aero_drag"]
    assert "terms" not in yaml.safe_load((tmp_path / "report" / "simulation.yaml").read_text())
    # A report may overwrite itself.
    write_report(drag(), tmp_path / "report")


def test_corrected_model_predicts_held_out_data(tmp_path: Path) -> None:
    write_report(drag(), tmp_path / "report")
    held_out = case("aero_drag", cda=DRAG).held_out
    before, after = (
        rmse(
            horizon_errors(
                load_surrogate(tmp_path / "report" / name).content, [Evidence(held_out)], (1.0,)
            )
        )[0]
        for name in ("simulation.yaml", "corrected.yaml")
    )
    assert after[0] < 0.3 * before[0]
    assert np.all(after < 1.1 * before)


def test_prediction_uses_no_later_measurement(tmp_path: Path) -> None:
    write_report(drag(), tmp_path / "report")
    model = load_surrogate(tmp_path / "report" / "corrected.yaml").content
    recording = case("aero_drag", cda=DRAG).held_out
    starts = np.array([4.0, 5.0])
    predicted = OpenLoopPredictor(model, recording).predict(starts, 40)
    cut = recording.between(0.0, 5.0 + 1e-9)
    # The commands stay predicted.
    cut = type(recording)(
        cut.name,
        recording.duration_s,
        cut.imu_s,
        cut.imu,
        cut.odometry_s,
        cut.odometry,
        cut.pose,
        recording.command_s,
        recording.command,
    )
    np.testing.assert_array_equal(OpenLoopPredictor(model, cut).predict(starts, 40), predicted)


def test_starts_are_on_the_tick_grid() -> None:
    starts = start_times_of(case().held_out, 40, 0.5, 2.0)
    np.testing.assert_allclose(starts, 2.0 + 0.5 * np.arange(starts.size), atol=1e-9)
    assert starts[-1] + 1.0 <= 30.1
