# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Direct comparisons in the sentence, the table and the JSON file."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.mismatch_report import drag

from adk_ros.mismatch.inference.result import NONE, MismatchResult
from adk_ros.mismatch.recording.direct_comparison import DirectComparison, Estimate
from adk_ros.mismatch.report.direct_table import direct_rows
from adk_ros.mismatch.report.result_files import as_dict
from adk_ros.mismatch.report.summary import sentence, verdict_text

_STEERING = DirectComparison(
    "steering_gain",
    "path curvature per steering angle at the mean speed",
    "1/m",
    Estimate(0.394, 0.002),
    Estimate(0.3683, 0.0012),
    0.013,
    ("steering_ratio", "compliance_steer", "front_tyre_stiffness"),
    ("v_y", "yaw_rate"),
    "",
    True,
)


def _silent() -> MismatchResult:
    return replace(drag(), verdict=NONE, effects=[], unexplained=None, direct=[_STEERING])


def test_the_headline_states_a_difference_that_no_claim_covers() -> None:
    text = sentence(_silent())
    assert text.startswith("Inconclusive")
    assert "No significant mismatch" not in text
    assert "differs by -6.5 % (-7.5 to -5.5), as steering ratio" in text
    assert verdict_text(_silent()) == "Inconclusive"


def test_a_program_must_read_the_caveat_next_to_the_verdict() -> None:
    answer = as_dict(_silent())
    assert answer["verdict"] == NONE
    assert answer["caveat"].startswith("inconclusive")
    assert answer["sentence"].startswith("Inconclusive")
    explained = as_dict(replace(drag(), direct=[_STEERING]))
    assert explained["direct"][0]["covered"] is False
    assert "Compared directly" in explained["sentence"]
    assert "caveat" not in explained


def test_a_difference_within_tolerance_is_not_stated() -> None:
    small = replace(_STEERING, recording=Estimate(0.39, 0.0012))
    result = replace(_silent(), direct=[small])
    assert "Compared directly" not in sentence(result)
    ((*_, decision),) = direct_rows(result)
    assert decision == "within build tolerance and error"


@pytest.mark.parametrize(("effects", "covered"), [(("aero_drag",), True), ((), False)])
def test_a_claim_covers_its_quantity(effects: tuple[str, ...], covered: bool) -> None:
    drag_area = replace(_STEERING, name="drag_area", effects=(*effects, "power_limit"))
    drag_area = replace(drag_area, equations=("v_x",))
    answer = as_dict(replace(drag(), direct=[drag_area]))["direct"]
    assert answer[0]["differs"] is True
    assert answer[0]["covered"] is covered
