# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk check on bags: text, JSON, parameter file, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.calibration import driven, mounted, scaled, write_streams

from adk_ros.api.recording import read_recording, recording_options
from adk_ros.bags import BagWriter, message
from adk_ros.cli.main import main


@pytest.fixture(scope="session")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag with an IMU upside down, a flipped hand-wheel angle and other joints."""
    streams = scaled("command", -16.0, "steering")(mounted(180.0, 0.0, 0.0)(driven("town", 2)))
    path = tmp_path_factory.mktemp("check") / "faulty"
    return write_streams(streams, path, ("motor", "column"))


def report(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    assert main(["check", *map(str, arguments), "--json"]) == 0
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return result


def names_of(result: dict[str, Any], verdict: str) -> set[str]:
    return {x["name"] for x in result["findings"] if x["verdict"] == verdict}


def test_a_sample_bag_as_text(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "bags/town", "--vehicle", "imdv"]) == 0
    out = capsys.readouterr().out
    assert "steering_ratio" in out
    assert "not decidable" not in out
    assert out.rstrip().endswith("next: nothing to correct")


def test_the_schema_of_the_json(capsys: pytest.CaptureFixture[str]) -> None:
    result = report(capsys, "bags/town", "--vehicle", "imdv")
    assert result["kind"] == "check"
    assert result["used_as"] == {
        "imu": "/imu/data", "odometry": "/odometry", "command": "/vehicle/command",
    }  # fmt: skip
    assert result["seconds"] == pytest.approx(60.0, abs=0.1)
    assert result["parameters"] == {}
    assert names_of(result, "finding") == set()
    for finding in result["findings"]:
        assert set(finding) == {
            "name", "verdict", "text", "value", "low", "high", "unit", "nominal",
            "standard_errors", "evidence", "seconds", "parameters", "remedy",
        }  # fmt: skip


def test_the_parameter_file_corrects_what_was_found(
    faulty: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    params = tmp_path / "params.yaml"
    result = report(capsys, faulty, "--vehicle", "imdv", "--out", params)
    assert names_of(result, "finding") >= {"joints", "imu_axes", "steering"}
    assert result["parameters"]["drive_joints"] == ["motor"]
    assert result["parameters"]["steer_joint"] == "column"
    assert result["parameters"]["steering_ratio"] == pytest.approx(-16.0, rel=0.05)
    assert result["parameters"]["imu_rotation"] == pytest.approx([3.1416, 0.0, 0.0])
    again = report(capsys, faulty, "--vehicle", "imdv", "--params", params)
    assert names_of(again, "finding") == set()
    assert again["parameters"] == {}
    # What train, replay and mismatch read is the car again.
    record = read_recording(faulty, recording_options(params=params)).frame
    known = record[["yaw_rate", "delta", "v_x", "a_y"]].dropna()
    assert known["yaw_rate"].corr(known["delta"]) > 0.8
    assert known["a_y"].corr(known["v_x"] * known["yaw_rate"]) > 0.9


def test_an_existing_file_is_kept(
    faulty: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "params.yaml"
    out.write_text("mine")
    assert main(["check", str(faulty), "--out", str(out)]) == 2
    assert "params.yaml" in capsys.readouterr().err
    assert out.read_text() == "mine"


def test_without_a_proposal_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "params.yaml"
    assert main(["check", "bags/town", "--vehicle", "imdv", "--out", str(out)]) == 0
    assert "no parameter to propose" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["nothing"], 2, "nothing"),
        (["bags/town", "--vehicle", "nothing.yaml"], 2, "nothing.yaml"),
        (["bags/town", "--imu", "/nothing"], 2, "/nothing"),
        (["bags/town", "--params", "nothing.yaml"], 2, "nothing.yaml"),
    ],
)
def test_wrong_arguments_get_one_line(
    arguments: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", *arguments]) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_a_bag_without_any_stream_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/chatter", "std_msgs/msg/String")
        writer.write("/chatter", message("std_msgs/msg/String", data="hello"), 10**18)
    assert main(["check", str(tmp_path / "bag")]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert "no IMU, odometry or command to check" in line


def test_the_road_is_written_as_a_table_and_a_figure(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    table, figure = tmp_path / "road.csv", tmp_path / "road.png"
    road = report(capsys, "bags/town", "--road", table)["road"]
    assert road["distance"] > 500.0
    assert road["grade"]["relative_error"] < 0.015
    head, *rows = table.read_text().splitlines()
    assert head.startswith("time_s,distance,place,direction,grade,grade_low,grade_high,bank,")
    assert len(rows) > 100
    assert main(["check", "bags/town", "--road", str(figure)]) == 0
    assert figure.read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()


def test_a_road_file_of_another_kind_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["check", "bags/town", "--road", str(tmp_path / "road.xlsx")]) == 2
    assert ".csv or .png or .svg" in capsys.readouterr().err


@pytest.mark.slow(seconds=10)
def test_what_has_changed_against_a_reference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, after = driven("handling", 1, 100.0), driven("handling", 2, 100.0)
    reference = write_streams(before, tmp_path / "before")
    bag = write_streams(scaled("odometry", 1.05, "v_x", "v_y")(after), tmp_path / "after")
    assert main(["check", str(bag), "--reference", str(reference)]) == 0
    out = capsys.readouterr().out
    assert "odometry's velocity has the factor: 1.05" in out
    assert "result: changed: odometry_scale" in out
    result = report(capsys, bag, "--reference", reference, "--vehicle", "imdv")
    assert result["kind"] == "check against reference"
    assert names_of(result, "finding") == {"odometry_scale"}
    assert result["candidates"] == {"odometry_scale": []}
    assert main(["check", str(bag), "--reference", str(reference), "--out", "p.yaml"]) == 2
    assert "--reference proposes no parameters" in capsys.readouterr().err


def test_an_assumed_length_measures_no_sensor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sheet = tmp_path / "sheet.yaml"
    sheet.write_text("mass: 1600.0\nwheelbase: 2.7\nwheel_radius: 0.3\n")
    result = report(capsys, "bags/town", "--vehicle", sheet)
    (warning,) = [text for text in result["warnings"] if "sheet.yaml" in text]
    assert "cg_to_front_axle, cg_to_rear_axle missing: what needs them is not checked" in warning
    found = {finding["name"]: finding for finding in result["findings"]}
    assert "the vehicle is unknown" in found["reference_point"]["text"]
    # The wheelbase is in the file.
    assert found["steering_ratio"]["verdict"] == "ok"
