# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A proposed map: three styles of column names, of which a person corrects three lines at most."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from helpers import importing as source
from helpers.train import drive, refused

from adk_ros.api.importing import import_recording, propose_map
from adk_ros.cli.main import main
from adk_ros.importing.column_names import recognise
from adk_ros.importing.map_file import factor_of
from adk_ros.importing.map_loading import checked_map
from adk_ros.signals.channels import Source

RATIO = 15.2
_STEP_S = 0.01


@lru_cache
def channels() -> dict[str, np.ndarray]:
    """Return a minute in the mountains at 100 Hz, SI: slope, bends, braking."""
    streams = drive("mountain", 60.0).streams
    t = np.arange(0.2, 59.5, _STEP_S)
    start = streams[Source.IMU].stamp_ns[0]
    out = {"t": t}
    for kind, names in source.NAMES.items():
        stamps = (streams[kind].stamp_ns - start) * 1e-9
        for i, name in enumerate(names):
            column = streams[kind].values[:, i]
            out[name] = np.interp(t, stamps, np.unwrap(column) if name == "heading" else column)
    return out


def english() -> tuple[pd.DataFrame, dict]:
    """Units in brackets, a hand-wheel angle."""
    c = channels()
    columns = {
        "Time [s]": c["t"],
        "Vehicle Speed [km/h]": c["v_x"] * 3.6,
        "Lateral Velocity [m/s]": c["v_y"],
        "Longitudinal Acceleration [g]": c["a_x"] / 9.80665,
        "Lateral Acceleration [g]": c["a_y"] / 9.80665,
        "Yaw Rate [deg/s]": np.degrees(c["yaw_rate"]),
        "Steering Wheel Angle [deg]": np.degrees(c["delta"]) * RATIO,
        "Wheel Torque [Nm]": c["torque"],
        "Brake Pressure [bar]": np.maximum(-c["torque"], 0.0) / 100.0,
        "Water Temp [degC]": np.full(c["t"].shape, 90.0),
    }
    truth = {
        "v_x": 1 / 3.6, "v_y": 1.0, "a_x": 9.80665, "a_y": 9.80665, "yaw_rate": np.pi / 180,
        "delta": np.pi / 180 / RATIO, "torque": 1.0, "brake_pressure": 1e5,
    }  # fmt: skip
    return pd.DataFrame(columns), truth


def german() -> tuple[pd.DataFrame, dict]:
    """No unit anywhere, a sign against ISO 8855."""
    c = channels()
    columns = {
        "Zeit": np.round(c["t"] * 1000).astype(np.int64),
        "Fahrzeuggeschwindigkeit": c["v_x"] * 3.6,
        "Längsbeschleunigung": c["a_x"],
        "Querbeschleunigung": -c["a_y"],
        "Gierrate": np.degrees(c["yaw_rate"]),
        "Lenkradwinkel": np.degrees(c["delta"]) * RATIO,
        "Antriebsmoment": c["torque"],
        "Raddrehzahl_VL": c["v_x"] / 0.32 * 30.0 / np.pi,
    }
    truth = {
        "v_x": 1 / 3.6, "a_x": 1.0, "a_y": -1.0, "yaw_rate": np.pi / 180,
        "delta": np.pi / 180 / RATIO, "torque": 1.0, "wheel_speed_front_left": np.pi / 30,
    }  # fmt: skip
    return pd.DataFrame(columns), truth


def abbreviated() -> tuple[pd.DataFrame, dict]:
    """Abbreviations; units that only the kinematics reveal."""
    c = channels()
    columns = {
        "t": c["t"],
        "IMU_ax": c["a_x"] / 9.80665,
        "IMU_ay": c["a_y"] / 9.80665,
        "IMU_psip": c["yaw_rate"],
        "CAN_VehSpd": c["v_x"] * 3.6,
        "delta": c["delta"],
        "MotTrq": c["torque"],
        "x": c["x"],
        "y": c["y"],
        "psi": np.degrees(c["heading"]),
    }
    truth = {
        "v_x": 1 / 3.6, "a_x": 9.80665, "a_y": 9.80665, "yaw_rate": 1.0, "delta": 1.0,
        "torque": 1.0, "x": 1.0, "y": 1.0, "heading": np.pi / 180,
    }  # fmt: skip
    return pd.DataFrame(columns), truth


def wrong_lines(proposed: dict, truth: dict[str, float]) -> set[str]:
    """Return the channels that a person has to correct: missing, surplus, or off by 2 %."""
    entries = checked_map("proposed", proposed).channels
    wrong = set(entries) ^ set(truth)
    for name in set(entries) & set(truth):
        entry = entries[name]
        factor = factor_of(name, entry) * entry.sign * entry.scale / entry.ratio
        if abs(factor / truth[name] - 1.0) > 0.02:
            wrong.add(name)
    return wrong


@pytest.mark.parametrize("style", [english, german, abbreviated], ids=lambda style: style.__name__)
def test_three_styles_need_three_corrections_at_most(tmp_path: Path, style) -> None:
    frame, truth = style()
    frame.to_csv(tmp_path / "a.csv", index=False)
    proposal = propose_map(tmp_path / "a.csv")
    wrong = wrong_lines(yaml.safe_load(proposal.text), truth)
    assert len(wrong) <= 3, proposal.text
    # What is wrong is marked, and so is little else.
    assert wrong <= set(proposal.uncertain), proposal.text
    assert len(proposal.uncertain) <= 3, proposal.text
    for guess in proposal.guesses:
        (line,) = [x for x in proposal.text.splitlines() if x.startswith(f"  {guess.channel}: ")]
        assert ("# check: " in line) == (not guess.is_certain)
        assert guess.reason
    (tmp_path / "map.yaml").write_text(proposal.text)
    result = import_recording(tmp_path / "a.csv", tmp_path / "map.yaml", tmp_path / "bag")
    assert result.not_imported == {}


def test_the_gyro_is_corrected_if_positions_contradict_it(tmp_path: Path) -> None:
    c = channels()
    flipped = {"yaw_rate", "a_y", "delta"}
    columns = {
        name: -c[name] if name in flipped else c[name]
        for name in ("t", "v_x", "a_x", "a_y", "yaw_rate", "delta", "torque", "x", "y")
    }
    pd.DataFrame(columns).to_csv(tmp_path / "a.csv", index=False)
    entries = yaml.safe_load(propose_map(tmp_path / "a.csv").text)["channels"]
    assert {name for name, entry in entries.items() if entry.get("sign") == -1} == flipped


def test_two_signs_against_one_are_a_guess(tmp_path: Path) -> None:
    c = channels()
    names = ("t", "v_x", "a_y", "yaw_rate", "delta")
    columns = {name: -c[name] if name in {"a_y", "delta"} else c[name] for name in names}
    pd.DataFrame(columns).to_csv(tmp_path / "a.csv", index=False)
    proposal = propose_map(tmp_path / "a.csv")
    assert yaml.safe_load(proposal.text)["channels"]["yaw_rate"]["sign"] == -1
    assert "yaw_rate" in proposal.uncertain
    assert "if left turns are negative, flip" in proposal.text


def test_a_compass_counts_from_north(tmp_path: Path) -> None:
    """Degrees, clockwise: 90 minus it is the heading from east."""
    c = channels()
    table = {name: c[name] for name in ("t", "v_x", "yaw_rate", "x", "y")}
    table["heading_deg"] = 90.0 - np.degrees(c["heading"])
    pd.DataFrame(table).to_csv(tmp_path / "a.csv", index=False)
    proposal = propose_map(tmp_path / "a.csv")
    entry = yaml.safe_load(proposal.text)["channels"]["heading"]
    assert (entry["unit"], entry["sign"], entry["offset"]) == ("deg", -1, -90.0)
    assert "heading" in proposal.uncertain


def test_formats_with_units_and_clocks_need_no_correction(tmp_path: Path) -> None:
    files = source.write_mdf(tmp_path)
    proposed = propose_map(files)
    assert "time" not in yaml.safe_load(proposed.text)
    assert wrong_lines(yaml.safe_load(proposed.text), dict.fromkeys(source.UNITS, 1.0)) == set()
    files = source.write_can(tmp_path, ".blf")
    proposed = propose_map(files, dbc=[tmp_path / "drive.dbc"])
    truth = {name: source.TO_SI[source.can_unit(name)[0]] for name in source.UNITS}
    assert wrong_lines(yaml.safe_load(proposed.text), truth) == set()


@pytest.mark.parametrize(
    ("column", "channel", "unit"),
    [
        ("ESP_Gierrate", "yaw_rate", ""),
        ("/imu/data.linear_acceleration.x", "a_x", ""),
        ("/odom.twist.twist.angular.z", "odometry_yaw_rate", ""),
        ("/odom.twist.covariance[0]", "", ""),
        ("vehicle_speed_kmh", "v_x", "km/h"),
        ("speed_limit", "", ""),
        ("WhlSpd_RR (rpm)", "wheel_speed_rear_right", "rpm"),
        ("StrgWhlAngle", "delta", ""),
        ("Bremsdruck [bar]", "brake_pressure", "bar"),
        ("GPS Speed", "gps_speed", ""),
        ("timestamp_ns", "time", "ns"),
        ("Oil pressure", "", ""),
        ("temperature", "", ""),
    ],
)
def test_names(column: str, channel: str, unit: str) -> None:
    name = recognise(column)
    assert (name.channel, name.unit) == (channel, unit)


def test_the_command_line_writes_the_map_and_says_what_to_check(capsys, tmp_path: Path) -> None:
    path, out = tmp_path / "a.csv", tmp_path / "map.yaml"
    english()[0].to_csv(path, index=False)
    assert main(["import", str(path), "--propose"]) == 0
    text = capsys.readouterr().out
    assert main(["import", str(path), "--propose", "--out", str(out)]) == 0
    said = capsys.readouterr().err
    assert out.read_text() == text
    assert "1 to check (delta)" in said
    assert f"next: adk import {path} --map {out} --out BAG" in said
    line = refused(capsys, ["import", path, "--propose", "--out", out], 2)
    assert "add --force to replace it" in line
    assert main(["import", str(path), "--propose", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["check"] == ["delta"]
    assert printed["channels"]["v_x"]["unit"] == "km/h"
    (tmp_path / "b.csv").write_text("q,w\n1,2\n3,4\n")
    assert "no column has a known name" in refused(
        capsys, ["import", tmp_path / "b.csv", "--propose"], 3
    )
