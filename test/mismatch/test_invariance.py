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
from adk_ros.plant.injection.injectors import UNLISTED

pytestmark = pytest.mark.slow(seconds=25)
INJECTED = {
    "": InjectedMismatch({}),
    "aero_drag": InjectedMismatch({"aero_drag": {"cda": 0.5}}),
    "front_tyre_stiffness": InjectedMismatch({"front_tyre_stiffness": {"scale": 0.8}}),
    "torque_cut": InjectedMismatch(unlisted={"torque_cut": UNLISTED["torque_cut"]}),
}


@cache
def made(name: str, recorded_s: float = 90.0, noise: float = 1.0) -> GeneratedCase:
    seconds = (60.0, recorded_s, 30.0)
    return make_case(name or "clean", INJECTED[name], 5, seconds=seconds, noise=noise)


@cache
def usual(name: str) -> MismatchResult:
    return analysed(made(name))


def analysed(case: GeneratedCase) -> MismatchResult:
    return identify_mismatch(case.simulation, case.recording, case.nominal)


def same(result: MismatchResult, name: str) -> bool:
    """Whether verdict, names and equations are those of the usual drive, and intervals overlap."""
    other = usual(name)
    sizes = [
        (x.parameters[key], y.parameters[key])
        for x, y in zip(result.effects, other.effects, strict=True)
        for key in x.parameters
    ]
    return (
        result.verdict == other.verdict
        and [x.effect.name for x in result.effects] == [x.effect.name for x in other.effects]
        and equations(result) == equations(other)
        and all(x.low < y.high and y.low < x.high for x, y in sizes)
    )


def equations(result: MismatchResult) -> list[str]:
    """Return the equations that are not explained."""
    return [] if result.unexplained is None else result.unexplained.equations


def width(result: MismatchResult) -> float:
    """Return the width of the first interval, relative to its value."""
    interval = next(iter(result.effects[0].parameters.values()))
    return (interval.high - interval.low) / interval.value


@pytest.mark.parametrize("name", INJECTED)
def test_the_usual_drive_is_judged_correctly(name: str) -> None:
    result = usual(name)
    if name == "torque_cut":
        assert (result.verdict, result.effects, equations(result)) == ("unknown", [], ["v_x"])
    else:
        assert result.verdict == ("explained" if name else "none")
        assert [x.effect.name for x in result.effects] == ([name] if name else [])


@pytest.mark.parametrize("name", INJECTED)
def test_twice_the_drive(name: str) -> None:
    result = analysed(made(name, recorded_s=180.0))
    assert same(result, name)
    if result.effects:
        assert width(result) < width(usual(name))


@pytest.mark.parametrize("name", INJECTED)
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


@pytest.mark.parametrize(("name", "noise"), zip(INJECTED, (0.5, 2.0, 0.5, 2.0), strict=True))
def test_other_noise(name: str, noise: float) -> None:
    assert same(analysed(made(name, noise=noise)), name)
