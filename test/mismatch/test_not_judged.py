# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings whose commands say nothing of the motion: scope, and no judgement."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.mismatch_drive import driven, simulated_car

from adk_ros.errors import DataError
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference.result import UNKNOWN, MismatchResult
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.report.result_files import CORRECTED_FILE, SIMULATION_FILE, write_report
from adk_ros.mismatch.report.summary import sentence, verdict_text
from adk_ros.mismatch.surrogate.identification import SurrogateModel

KNOWN = SurrogateModel(simulated_car(), np.zeros(6), np.zeros((6, 100)), np.empty((0, len(INDEX))))
"""A surrogate as from a file, so that no simulation must be identified."""


def with_commands(factors: list[float], has_command: bool = True) -> SensorLog:
    log = driven()
    return replace(log, command=log.command * np.array(factors), has_command=has_command)


def scope_of(result: MismatchResult) -> dict[str, tuple[str, str]]:
    return {row.name: (row.possible.value, row.why) for row in result.scope}


def test_a_recording_without_commands_is_answered_with_its_scope(tmp_path: Path) -> None:
    log = with_commands([0.0, 0.0], has_command=False)
    result = identify_mismatch(KNOWN, log, ask=["aero_drag"])
    assert result.verdict == UNKNOWN
    assert result.effects == []
    assert result.not_judged == sorted(EFFECTS)
    assert [x.what for x in result.missing_channels] == ["a command"]
    scope = scope_of(result)
    assert scope["predict v_x"][0] == "reduced"
    assert scope["judge yaw rate"] == ("no", "the recording has no command")
    assert (
        verdict_text(result) == "Not judged: the recorded commands do not say what moves the car"
    )
    assert "record the wheel torque in N·m and the angle of the road wheels" in sentence(result)
    assert not result.asked[0].claimed
    write_report(result, tmp_path / "report")
    content = json.loads((tmp_path / "report" / "mismatch.json").read_text())
    assert content["verdict"] == "unknown"
    assert content["scope"]["rows"] == [row.as_dict() for row in result.scope]
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "the recording has no command" in page
    models = [(tmp_path / "report" / x).read_text() for x in (SIMULATION_FILE, CORRECTED_FILE)]
    assert models[0] == models[1]


@pytest.mark.parametrize(
    ("factors", "why"),
    [
        ([0.0, 0.0], "torque of the command is 0 throughout"),
        ([1.0, 0.0], "analysed without a steering angle in bends"),
    ],
)
def test_constant_commands_are_answered_as_well(factors: list[float], why: str) -> None:
    result = identify_mismatch(KNOWN, with_commands(factors))
    assert result.verdict == UNKNOWN
    scope = scope_of(result)
    assert scope["judge v_x"] == ("no", why)
    assert scope["judge yaw rate"][0] == "no"


def test_recordings_with_and_without_commands_are_not_analysed_jointly() -> None:
    other = driven(drag_area=0.7)
    other = replace(other, name="other", command=0.0 * other.command, has_command=False)
    with pytest.raises(DataError, match="analyse them separately"):
        identify_mismatch(KNOWN, [driven(), other])
