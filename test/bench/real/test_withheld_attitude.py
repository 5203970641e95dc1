# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench real: the slope without the attitude, compared with it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.road import as_streams, hilly

import adk_ros.bench.real.withheld_attitude as withheld_attitude
from adk_ros.bench.real.withheld_attitude import slope_outcomes
from adk_ros.calibration.check import CheckResult
from adk_ros.calibration.from_bag import BagContent
from adk_ros.calibration.joints import JointTable
from adk_ros.calibration.road import check_road
from adk_ros.signals.decode import SensorConfig

HILLY = as_streams(hilly(seconds=60.0), attitude=True)


def test_the_profile_is_compared_with_the_attitude_that_it_did_not_see(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def checked(content: BagContent) -> CheckResult:
        assert content.streams.attitude is None
        findings, road = check_road(content.streams, ())
        return CheckResult(findings, {}, "", road)

    monkeypatch.setattr(withheld_attitude, "check", checked)
    content = BagContent(HILLY, {}, SensorConfig(), JointTable(), "", [])
    grade = next(x for x in slope_outcomes("car", "drive", content) if x.slope == "grade")
    assert grade.correlation > 0.95
    assert grade.is_counted
    none, withheld, used = grade.v_x_error
    assert max(withheld, used) < 0.2 * none


def test_without_an_attitude_there_is_nothing_to_compare_with() -> None:
    streams = replace(HILLY, attitude=None)
    content = BagContent(streams, {}, SensorConfig(), JointTable(), "", [])
    assert slope_outcomes("car", "drive", content) == []
