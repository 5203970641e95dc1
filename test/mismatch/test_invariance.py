# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A verdict does not depend on the length of the drive, the rate or the noise of the sensors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from adk_ros.bench.mismatch.case_generator import GeneratedCase, InjectedMismatch, make_case
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.recording.sensor_log import SensorLog

pytestmark = pytest.mark.slow(seconds=25)
NAMES = ("", "aero_drag")


@cache
def made(name: str, recorded_s: float = 90.0, noise: float = 1.0) -> GeneratedCase:
    injected = InjectedMismatch({name: {"cda": 0.5}} if name else {})
    return make_case(name or "clean", injected, 5, seconds=(60.0, recorded_s, 30.0), noise=noise)


@cache
def usual(name: str) -> MismatchResult:
    return analysed(made(name))


def analysed(case: GeneratedCase) -> MismatchResult:
    return identify_mismatch(case.simulation, case.recording, case.nominal)


def same(result: MismatchResult, name: str) -> bool:
    """Whether verdict and names are those of the usual drive, and the intervals overlap."""
    other = usual(name)
    sizes = [
        (x.parameters["cda"], y.parameters["cda"])
        for x, y in zip(result.effects, other.effects, strict=True)
    ]
    return result.verdict == other.verdict and all(
        x.low < y.high and y.low < x.high for x, y in sizes
    )


def test_the_usual_drive_is_judged_correctly() -> None:
    assert (usual("").verdict, usual("aero_drag").verdict) == ("none", "explained")


@pytest.mark.parametrize("name", NAMES)
def test_twice_the_drive(name: str) -> None:
    result = analysed(made(name, recorded_s=180.0))
    assert same(result, name)
    if name:
        width, before = (
            r.effects[0].parameters["cda"].high - r.effects[0].parameters["cda"].low
            for r in (result, usual(name))
        )
        assert width < before


@pytest.mark.parametrize("name", NAMES)
def test_half_the_odometry_rate(name: str) -> None:
    def slower(log: SensorLog) -> SensorLog:
        return replace(
            log,
            odometry_s=log.odometry_s[::2],
            odometry=log.odometry[::2],
            pose=log.pose[::2],
        )

    case = made(name)
    assert same(analysed(replace(case, recording=slower(case.recording))), name)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("noise", [0.5, 2.0])
def test_other_noise(name: str, noise: float) -> None:
    assert same(analysed(made(name, noise=noise)), name)
