# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Faults that a simulated car gets between two drives are named with their size."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.calibration import (
    Fault,
    added,
    displaced,
    driven,
    late,
    low_passed,
    mounted,
    scaled,
)

from adk_ros.calibration.change import same_course
from adk_ros.calibration.finding import Verdict
from adk_ros.calibration.from_bag import BagContent
from adk_ros.calibration.joints import JointTable
from adk_ros.calibration.reference_check import (
    Prepared,
    ReferenceCheck,
    check_against,
    prepared,
)
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.signals.decode import SensorConfig


def of(streams: Streams) -> Prepared:
    topics: dict[str, str | None] = {}
    content = BagContent(streams, topics, SensorConfig(), JointTable(), "joint_state", [])
    return prepared(content)


@lru_cache(maxsize=4)
def reference(seconds: float = 200.0) -> Prepared:
    return of(driven("handling", 1, seconds))


def against(fault: Fault) -> ReferenceCheck:
    """Return the check of another drive of the car on the same course, with a fault."""
    return check_against(reference(), of(fault(driven("handling", 2))))


def cut(streams: Streams, begin_s: float, end_s: float) -> Streams:
    def part(stream: Stream | None) -> Stream | None:
        if stream is None:
            return None
        inside = (stream.at_s >= begin_s) & (stream.at_s < end_s)
        columns = {name: values[inside] for name, values in stream.columns.items()}
        return replace(stream, at_s=stream.at_s[inside], columns=columns)

    return replace(
        streams,
        imu=part(streams.imu),
        odometry=part(streams.odometry),
        command=part(streams.command),
    )


@pytest.mark.parametrize(
    ("fault", "label", "size", "candidates"),
    [
        (added("imu", a_x=0.5), "imu_bias.a_x", 0.5, set()),
        (added("imu", a_y=-0.7), "imu_bias.a_y", -0.7, set()),
        (added("imu", w_z=0.01), "imu_bias.gyro", 0.01, set()),
        (mounted(4.0, 0.0, 0.0), "imu_tilt.roll", np.radians(4.0), set()),
        (mounted(0.0, -4.0, 0.0), "imu_tilt.pitch", np.radians(-4.0), set()),
        (displaced(1.5, 0.0), "imu_lever_arm.x", 1.5, set()),
        (displaced(0.0, -1.5), "imu_lever_arm.y", -1.5, set()),
        (late("imu", 0.06), "imu_delay", 0.06, set()),
        (scaled("odometry", 1.04, "v_x", "v_y"), "odometry_scale", 1.04, set()),
        (scaled("imu", 0.95, "w_z"), "gyro_scale", 0.95, set()),
        (low_passed("odometry", 0.15, "yaw_rate"), "odometry_filter", 0.15, set()),
        (late("command", -0.1), "clock_offset", 0.1, {"steering_delay"}),
        (added("command", steering=0.01), "steering_offset", 0.01, set()),
        (scaled("command", 1.12, "steering"), "steering_ratio", 1.12, set()),
    ],
)
def test_a_fault_is_the_only_change(
    fault: Fault, label: str, size: float, candidates: set[str]
) -> None:
    result = against(fault)
    assert result.comparison is not None
    (change,) = result.comparison.changes
    assert change.fit.fault.label == label
    assert {x.fault.label for x in change.candidates} <= candidates
    # The filter of the helper and the differentiation of a lever arm are not exact.
    assert change.fit.size == pytest.approx(size, abs=0.06 * abs(change.fit.change) + 1e-4)
    finding = result.of(Verdict.FINDING)[0]
    assert finding.name == label
    assert finding.low is not None
    assert finding.high is not None
    assert finding.low < finding.high
    assert label in result.advice


def test_nothing_changed_is_said() -> None:
    result = against(lambda streams: streams)
    assert not result.of(Verdict.FINDING)
    assert len(result.of(Verdict.OK)) >= 10
    assert result.advice.startswith("nothing changed")


def test_a_flipped_sign_is_a_change() -> None:
    flipped = scaled("imu", -1.0, "a_y")
    found = against(flipped).of(Verdict.FINDING)
    assert [x.name for x in found] == ["imu_axes"]
    back = check_against(of(flipped(driven("handling", 2))), reference()).of(Verdict.FINDING)
    assert "no longer so" in back[0].text


def test_two_faults_are_found_one_after_the_other() -> None:
    def both(streams: Streams) -> Streams:
        return added("imu", a_x=0.5)(scaled("odometry", 1.05, "v_x", "v_y")(streams))

    result = against(both)
    found = {x.name: x.value for x in result.of(Verdict.FINDING)}
    assert found == pytest.approx({"imu_bias.a_x": 0.5, "odometry_scale": 1.05}, rel=0.05)


def test_faults_without_channels_are_said_to_be_undecidable() -> None:
    def without_imu(seed: int) -> Prepared:
        return of(replace(driven("handling", seed), imu=None))

    result = check_against(without_imu(1), without_imu(2))
    said = {x.name: x for x in result.findings}
    assert said["imu_delay"].verdict is Verdict.NOT_DECIDABLE
    assert "lack the channels" in said["imu_delay"].text
    assert said["odometry_scale"].verdict is Verdict.OK


def test_a_copied_channel_is_no_evidence() -> None:
    def copied(streams: Streams) -> Streams:
        odometry, imu = streams.odometry, streams.imu
        assert odometry is not None
        assert imu is not None
        rate = np.interp(imu.at_s, odometry.at_s, odometry["yaw_rate"])
        columns = {name: np.full(odometry.at_s.size, np.nan) for name in ("x", "y", "heading")}
        return replace(streams, odometry=odometry.having(**columns), imu=imu.having(w_z=rate))

    known, seen = (of(copied(driven("handling", seed))) for seed in (1, 2))
    comparison = check_against(known, seen).comparison
    assert comparison is not None
    assert "gyro" not in comparison.relations


def test_a_short_recording_is_undecidable() -> None:
    result = check_against(reference(), of(cut(driven("handling", 2), 0.0, 7.0)))
    assert result.comparison is None
    assert [x.name for x in result.findings] == ["calibration"]


def test_another_course_explains_an_offset() -> None:
    other = driven("town", 2)
    steered = check_against(reference(), of(added("command", steering=0.02)(other)))
    assert steered.comparison is not None
    assert steered.comparison.is_same_course is False
    said = {x.name: x for x in steered.findings}["steering_offset"]
    assert said.verdict is Verdict.NOT_DECIDABLE
    known, same = reference().signals, of(driven("handling", 2)).signals
    assert known is not None
    assert same is not None
    assert same_course(known, same)
