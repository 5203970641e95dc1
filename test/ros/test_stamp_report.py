# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The diagnostics name the stream whose stamps are wrong, not those that suffer from it."""

from pathlib import Path
from typing import Any

import pytest
from helpers.node import Change, Rig, write_model

from adk_ros.model import artefact
from adk_ros.model.koopman import KoopmanModel
from adk_ros.ros.diagnostics import DiagnosticReport, Level
from adk_ros.ros.messages import join_stamp, split_stamp
from adk_ros.ros.traffic import Rates
from adk_ros.signals.channels import STANDARD_SOURCES, Source

YEAR_S = 365.25 * 86400.0


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> KoopmanModel:
    folder: Path = write_model(tmp_path_factory.mktemp("model") / "model")
    return artefact.load(folder).model


def shifted(source: Source, by_s: float) -> Change:
    def change(given: Source, msg: Any) -> Any:
        if given is source:
            stamp_ns = join_stamp(msg.header.stamp) + round(by_s * 1e9)
            msg.header.stamp.sec, msg.header.stamp.nanosec = split_stamp(stamp_ns)
        return msg

    return change


def seconds(report: DiagnosticReport, key: str) -> float:
    return float(dict(report.values)[key])


@pytest.mark.parametrize(
    ("source", "by_s", "text"),
    [
        (Source.COMMAND, 0.1, "command stamps are 0.1 s ahead of the other streams"),
        (Source.IMU, 0.2, "imu stamps are 0.2 s ahead of the other streams"),
        (Source.ODOMETRY, -0.15, "odometry stamps are 0.15 s behind the other streams"),
    ],
)
def test_the_stream_that_differs_is_named(
    model: KoopmanModel, source: Source, by_s: float, text: str
) -> None:
    rig = Rig(model)
    rig.drive(3.0)
    report = rig.drive(3.0, shifted(source, by_s))[-1]
    assert report.level is Level.WARN
    assert report.message.startswith(text)
    for other in STANDARD_SOURCES:
        name = other.name.lower()
        lead_s = by_s if other is source else 0.0
        assert seconds(report, f"{name}.stamps_ahead_of_others_s") == pytest.approx(lead_s)
        assert seconds(report, f"{name}.stamps_behind_clock_s") == pytest.approx(-lead_s)
        assert f"{name} stamps are" not in report.message or other is source
    rig.drive(4.0)
    assert rig.reports[-1].level is Level.OK


def test_late_readings_are_counted_by_stream(model: KoopmanModel) -> None:
    rig = Rig(model)
    report = rig.drive(5.0, shifted(Source.COMMAND, 0.1))[-1]
    assert "250 readings too late for their sample (imu 200, odometry 50)" in report.message


@pytest.mark.parametrize("imu_hz", [200.0, 1000.0])
@pytest.mark.parametrize("from_start", [True, False])
def test_an_imu_of_another_time_is_unused(
    model: KoopmanModel, imu_hz: float, from_start: bool
) -> None:
    """Predictions go on, and the report says what is not used and why."""
    rig = Rig(model, rates=Rates(imu_hz=imu_hz))
    if not from_start:
        rig.drive(3.0)
    published = len(rig.published)
    report = rig.drive(4.0, shifted(Source.IMU, 10.0 * YEAR_S))[-1]
    assert report.level is Level.WARN
    assert "unused: " in report.message
    assert "imu stamps are 10 years ahead of the other streams" in report.message
    assert f"time stamps ignored (imu {imu_hz:.0f})" in report.message
    assert len(rig.published) - published > 150
    assert seconds(report, "imu.stamps_ahead_of_others_s") == pytest.approx(
        10.0 * YEAR_S, rel=1e-4
    )


@pytest.mark.parametrize("by_s", [0.3, 0.5])
def test_two_streams_are_compared_with_the_clock(model: KoopmanModel, by_s: float) -> None:
    rig = Rig(model, rates=Rates(imu_hz=0.0))
    report = rig.drive(4.0, shifted(Source.COMMAND, by_s))[-1]
    assert f"command stamps are {by_s:g} s ahead of the other streams" in report.message
    blind = Rig(model, rates=Rates(imu_hz=0.0))
    blind.sim_time = (True, False)
    report = blind.drive(4.0, shifted(Source.COMMAND, by_s))[-1]
    assert f"odometry and command stamps are {by_s:g} s apart" in report.message
    assert "odometry.stamps_ahead_of_others_s" not in dict(report.values)


def test_a_recording_played_late_is_compared_by_its_streams(model: KoopmanModel) -> None:
    """All stamps are a year behind the clock: nothing is wrong with that."""
    rig = Rig(model)

    def aged(source: Source, msg: Any) -> Any:
        return shifted(source, -YEAR_S)(source, msg)

    report = rig.drive(4.0, aged)[-1]
    assert report.level is Level.OK
    assert seconds(report, "imu.stamps_behind_clock_s") == pytest.approx(YEAR_S, rel=1e-4)
    assert seconds(report, "imu.stamps_ahead_of_others_s") == pytest.approx(0.0)


def test_a_jump_of_all_stamps_is_no_difference(model: KoopmanModel) -> None:
    rig = Rig(model)
    rig.drive(3.0)
    for offset_s in (-20.0, 300.0, 5.0):
        rig.drive(0.4)
        rig.stamp_offset_ns += round(offset_s * 1e9)
        for report in rig.drive(2.0):
            assert "stamps are" not in report.message
