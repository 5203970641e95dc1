# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Torque from pedals: `adk check` proposes the map, `adk import` applies and marks it."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from helpers.train import refused
from helpers.wheels import (
    FULL_BRAKE,
    FULL_DRIVE,
    GRIP_FREE,
    bus,
    bus_map,
    driven,
    pedals,
    read_frame,
)

from adk_ros.api.check import check_recording
from adk_ros.api.exporting import export
from adk_ros.api.importing import import_recording, propose_map
from adk_ros.calibration.finding import Finding
from adk_ros.errors import UsageError
from adk_ros.importing.map_loading import checked_map
from adk_ros.importing.recording_import import ImportedRecording
from adk_ros.mismatch.recording.from_bag import read_sensor_log

RADIUS = 0.325
_BAR = 1e5
_PRESSURE = 100.0 * _BAR
"""Pa at full brake."""


@lru_cache
def table() -> pd.DataFrame:
    drive = driven(GRIP_FREE, 180.0, 0.5)
    throttle, brake = pedals(drive)
    frame = bus(drive).drop(columns=["torque", "gps_speed"])
    return frame.assign(v_x=drive.x[:, 0], throttle=100.0 * throttle, brake=100.0 * brake)


def pedal_map(**torque: Any) -> dict[str, Any]:
    content = bus_map("torque", "gps_speed")
    content["channels"] |= {
        "v_x": {"column": "v_x", "unit": "m/s"},
        "throttle": {"column": "throttle", "unit": "%"},
        "brake_pressure": {"column": "brake", "unit": "bar"},
    }
    content["computed"] = {"torque": {"from": "pedals", "wheel_radius": RADIUS} | torque}
    return content


LINEAR = {
    "throttle": {"pedal": [0.0, 1.0], "force": [0.0, FULL_DRIVE / RADIUS]},
    "brake_pressure": {"pedal": [0.0, _PRESSURE], "force": [0.0, -FULL_BRAKE / RADIUS]},
}


def torque_of(recording: ImportedRecording) -> np.ndarray:
    (torque,) = [channel for channel in recording.channels if channel.name == "torque_estimated"]
    return torque.values


def without_torque(folder: Path) -> dict[str, Any]:
    """Import pedals alone into the bag `first` of a folder; return the map."""
    content = pedal_map()
    del content["computed"]
    table().to_csv(folder / "a.csv", index=False)
    import_recording(folder / "a.csv", content, folder / "first")
    return content


def proposed(folder: Path, vehicle: str | None = None) -> Finding:
    """Return what a check of that bag says of the pedals."""
    findings = check_recording(folder / "first", vehicle).result.findings
    (finding,) = [x for x in findings if x.name == "pedal_map"]
    return finding


@pytest.mark.slow(seconds=10)
def test_the_proposed_map_gives_the_torque(tmp_path: Path) -> None:
    content = without_torque(tmp_path)
    finding = proposed(tmp_path, "imdv")
    assert finding.verdict.value == "finding"
    assert finding.low is not None
    assert finding.high is not None
    assert "an error of the mass scales it" in finding.text
    computed = finding.remedy.split("computed: ")[1].split("; use it")[0]
    content["computed"] = yaml.safe_load(computed)
    import_recording(tmp_path / "a.csv", content, tmp_path / "second")
    log = read_sensor_log(tmp_path / "second")
    truth = driven(GRIP_FREE, 180.0, 0.5).u[:, 0]
    error = log.command[:, 0] - truth[: log.command.shape[0]]
    assert np.sqrt(np.mean(error**2)) < 0.15 * np.sqrt(np.mean(truth**2))
    # It follows from the motion, and is no evidence about it.
    assert log.torque_is_inferred
    findings = {x.name: x for x in check_recording(tmp_path / "second", "imdv").result.findings}
    assert "estimated it from pedals" in findings["torque"].text
    assert "pedal_map" not in findings


def test_the_mark_survives_an_export(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    table()[table()["t"] < 20.0].to_csv(path, index=False)
    import_recording(path, pedal_map(**LINEAR), tmp_path / "bag")
    export(tmp_path / "bag", "csv", tmp_path / "b.csv")
    proposal = propose_map(tmp_path / "b.csv")
    import_recording(tmp_path / "b.csv", yaml.safe_load(proposal.text), tmp_path / "again")
    first, again = (read_sensor_log(tmp_path / name) for name in ("bag", "again"))
    assert again.torque_is_inferred
    assert np.array_equal(first.command, again.command)


def test_a_measured_torque_is_evidence(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    table().assign(torque=1000.0 * np.sin(table()["t"])).to_csv(path, index=False)
    content = pedal_map()
    del content["computed"]
    content["channels"]["torque"] = {"column": "torque", "unit": "N m"}
    import_recording(path, content, tmp_path / "bag")
    assert not read_sensor_log(tmp_path / "bag").torque_is_inferred
    names = {x.name for x in check_recording(tmp_path / "bag", "imdv").result.findings}
    assert "pedal_map" not in names


def test_without_a_mass_no_map_is_proposed(tmp_path: Path) -> None:
    without_torque(tmp_path)
    finding = proposed(tmp_path)
    assert finding.text.endswith("a force needs mass and wheel radius: give --vehicle")


def test_tables_are_applied_at_the_pedals_stamps(tmp_path: Path) -> None:
    recording = read_frame(tmp_path, table(), pedal_map(**LINEAR))
    throttle, brake = table()["throttle"] / 100.0, table()["brake"] / 100.0
    expected = FULL_DRIVE * np.minimum(throttle, 1.0) - FULL_BRAKE * brake
    assert torque_of(recording) == pytest.approx(expected.to_numpy(), rel=1e-9)
    assert any(line.startswith("torque is estimated from throttle") for line in recording.notes)


def test_reverse_and_standstill(tmp_path: Path) -> None:
    frame = table().assign(throttle=50.0, brake=10.0)
    third = len(frame) // 3
    frame["v_x"] = np.repeat([-2.0, 0.0, 2.0], [third, third, len(frame) - 2 * third])
    frame["gear"] = np.where(frame["v_x"] < 0.0, -1.0, 1.0)
    content = pedal_map(**LINEAR)
    content["channels"]["gear"] = {"column": "gear", "unit": "1"}
    torque = torque_of(read_frame(tmp_path, frame, content))
    drive, brake = 0.5 * FULL_DRIVE, 0.1 * FULL_BRAKE
    at = [third // 2, 3 * third // 2, 5 * third // 2]
    assert torque[at] == pytest.approx([brake - drive, drive, drive - brake])


@pytest.mark.parametrize(
    ("torque", "line"),
    [
        ({}, "computed.torque: give throttle, brake_pedal or brake_pressure"),
        ({"wheel_radius": 0.0, **LINEAR}, "computed.torque.wheel_radius: Input should be greater"),
        ({"brake_pedal": LINEAR["brake_pressure"], **LINEAR}, "brake_pressure, not both"),
        ({"throttle": {"pedal": [0, 1], "force": [0]}}, "a number for each position of the pedal"),
        ({"throttle": {"pedal": [1, 0], "force": [0, 1]}}, "throttle: pedal must ascend"),
        ({"throttle": {"pedal": [0, 1], "force": [0, "x"]}}, "a number for each position"),
        ({"throttle": {"pedal": [0, 1], "force": [[0, 1]]}}, "a row for each speed or gear"),
        (
            {"throttle": {"pedal": [0, 1], "speed": [1, 2], "force": [[0, 1]]}},
            "a row for each speed or gear",
        ),
        (
            {"throttle": {"pedal": [0, 1], "speed": [1], "gear": [1], "force": [[0, 1]]}},
            "give speed or gear, not both",
        ),
        (
            {"throttle": {"pedal": [0, 1], "gear": [1], "force": [[0, 1]]}},
            "computed.torque: needs channels.gear",
        ),
        (
            {"brake_pedal": {"pedal": [0, 1], "force": [0, -1]}},
            "computed.torque: needs channels.brake_pedal",
        ),
    ],
)
def test_a_wrong_entry_is_refused_in_one_line(torque: dict, line: str) -> None:
    with pytest.raises(UsageError) as refusal:
        checked_map("map.yaml", pedal_map(**torque))
    assert line in str(refusal.value)
    assert str(refusal.value).startswith("map.yaml: computed.torque")


def test_two_torques_are_refused() -> None:
    content = pedal_map(**LINEAR)
    entry = {"column": "T", "unit": "N m"}
    content["channels"]["torque"] = entry
    with pytest.raises(UsageError, match=r"channels\.torque is given as well: leave out one"):
        checked_map("m", content)
    del content["computed"]
    content["channels"]["torque_estimated"] = entry
    with pytest.raises(UsageError, match="give torque or torque_estimated, not both"):
        checked_map("m", content)


def test_a_torque_without_a_velocity_is_refused(capsys, tmp_path: Path) -> None:
    content = pedal_map(**LINEAR)
    del content["channels"]["v_x"]
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(content))
    table().to_csv(tmp_path / "a.csv", index=False)
    arguments = ["import", tmp_path / "a.csv", "--map", tmp_path / "map.yaml"]
    printed = refused(capsys, [*arguments, "--out", tmp_path / "bag"], 2)
    assert "map.yaml: computed.torque: needs v_x, in channels or computed" in printed
