# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ablation: pedal to torque conversion, calibrated surrogate, and removal of terms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.bench.mismatch.ablation import (
    AblationResult,
    ablation_criteria,
    calibrate_surrogate,
    removals,
    with_torque,
)
from adk_ros.bench.mismatch.acceptance import FAIL, PASS
from adk_ros.bench.mismatch.case_score import CaseResult, score_case
from adk_ros.bench.paper.av21 import find_recordings
from adk_ros.errors import DataError
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import SensorLog


def with_pedal(e: SensorLog, full: float = 3000.0) -> SensorLog:
    return replace(e, command=e.command * np.array([1.0 / full, 1.0]))


def test_a_pedal_position_is_converted_to_its_torque() -> None:
    whole, nominal = case().recording, case().nominal
    converted, note = with_torque(with_pedal(whole), nominal.mass, nominal.wheel_radius)
    ratio = converted.command[:, 0].std() / whole.command[:, 0].std()
    assert ratio == pytest.approx(1.0, abs=0.1)
    assert "N·m at full throttle" in note
    flipped = with_pedal(whole, -3000.0)
    with pytest.raises(DataError, match="does not accelerate"):
        with_torque(flipped, nominal.mass, nominal.wheel_radius)


def test_a_term_is_removed_from_the_calibrated_surrogate() -> None:
    calibrated = calibrate_surrogate(with_pedal(case().recording), case().nominal)
    (note,) = calibrated.notes
    assert "full brake" in note
    assert calibrated.surrogate.error[[0, 3]].max() < 0.2
    drag, steering = removals(calibrated.surrogate)
    less = steering.out_of(calibrated.surrogate)
    i = INDEX["steer_gain"]
    assert less.parameters[i] == pytest.approx(calibrated.surrogate.parameters[i] * 2.0 / 3.0)
    assert drag.out_of(calibrated.surrogate).parameters[INDEX["drag_area"]] == 0.0
    label = steering.label(0.0, 10.0)
    (effect,) = label["effects"]
    assert effect["params"]["scale"] == pytest.approx(
        1.0 + calibrated.surrogate.parameters[i] / 3.0
    )
    assert score_case("x", label, {"verdict": "none"}).kind == "single"


def test_criteria_by_removed_term() -> None:
    def result(removed: str, right: float, best: str) -> AblationResult:
        return AblationResult(
            "a", removed, CaseResult("a", "single", right, right, "", removed), best, 0.1
        )

    nothing, drag = ablation_criteria(
        [result("", 1.0, "cg_shift"), result("aero_drag", 1.0, "aero_drag"),
         result("aero_drag", 0.0, "aero_drag")]
    )  # fmt: skip
    assert (nothing.verdict, nothing.name) == (PASS, "real-nothing-removed")
    assert drag.verdict == FAIL
    assert str(drag) == (
        "FAIL real-aero_drag-removed 1 of 2 recordings, best single effect in 2 (named in all)"
    )


def test_recordings_are_found_below_a_folder(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no recording"):
        find_recordings(tmp_path)
    with pytest.raises(DataError, match="no recording"):
        find_recordings(tmp_path / "none")
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "metadata.yaml").write_text("x")
    assert find_recordings(tmp_path) == (tmp_path / "a" / "b",)
