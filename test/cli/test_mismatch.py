# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk mismatch and adk bench concealed on bags, and their errors."""

from __future__ import annotations

import json
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.mismatch import case
from helpers.mismatch_report import drag

from adk_ros.bench.mismatch.case_files import write_case
from adk_ros.cli.main import main
from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.inference.asked_effect import AskedEffect
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.offline.sensor_log_bag import write_sensor_log

pytestmark = pytest.mark.usefixtures("unrendered")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cases") / "drag"
    write_case(case("aero_drag", cda=1.0), path)
    return path


def refused(capsys: pytest.CaptureFixture[str], code: int, *arguments: str) -> str:
    assert main([*arguments]) == code
    """Run `adk`, which must end with `code` and a one-line error; return the line."""
    printed = capsys.readouterr()
    assert printed.out == ""
    lines = [line for line in printed.err.splitlines() if not line.startswith("warning")]
    assert len(lines) == 1
    assert lines[0].startswith("adk: ")
    return lines[0]


@pytest.mark.slow
def test_a_bag_round_trip_keeps_the_sensor_log(folder: Path) -> None:
    written, read = case("aero_drag", cda=1.0).recording, read_sensor_log(folder / "recording")
    np.testing.assert_allclose(read.imu, written.imu, atol=1e-12)
    np.testing.assert_allclose(read.odometry, written.odometry, atol=1e-12)
    np.testing.assert_allclose(read.pose[:, :2], written.pose[:, :2], atol=1e-12)
    turned = read.pose[:, 2] - written.pose[:, 2]
    np.testing.assert_allclose(turned, turned[0], atol=1e-9)
    np.testing.assert_allclose(read.command, written.command, atol=1e-12)
    np.testing.assert_allclose(read.odometry_s, written.odometry_s, atol=1e-6)


@pytest.mark.slow
def test_the_bench_runs_and_scores_a_case(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["bench", "concealed", "--cases", str(folder.parent), "--json"]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 0
    result = json.loads(capsys.readouterr().out)
    (score,) = result["cases"]
    assert score["failure"] == ""
    assert score["right"] == 1.0
    assert score["errors"]["aero_drag.cda"] < 0.05
    assert score["removed"]["v_x"] > 0.7
    (first, *_) = result["criteria"]
    assert (first["name"], first["verdict"]) == ("singles-strength-1", "PASS")
    assert (tmp_path / "out" / "criteria.txt").is_file()
    report = tmp_path / "out" / "drag"
    assert {p.name for p in report.iterdir()} >= {
        "mismatch.json",
        "simulation.yaml",
        "corrected.yaml",
        "held_out.yaml",
    }


def test_rollout_of_a_surrogate_model(folder: Path, tmp_path: Path) -> None:
    model, out = tmp_path / "model.yaml", tmp_path / "r.csv"
    model.write_text(surrogate_yaml(default_parameters()))
    bag = str(folder / "heldout")
    arguments = ["rollout", "--model", str(model), "--bag", bag, "--out", str(out)]
    assert main([*arguments, "--horizon", "1", "--stride", "0.5"]) == 0
    table = np.genfromtxt(out, delimiter=",", names=True)
    starts = np.unique(table["start_s"])
    np.testing.assert_allclose(starts, 2.0 + 0.5 * np.arange(starts.size), atol=1e-6)
    assert table.size == 40 * starts.size
    assert np.isfinite(table["v_x"]).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parameters": {"mess": 1.0}}, "parameter 'mess' is unknown"),
        ({"parameters": {"mass": -1.0}}, "mass must be"),
        ({"terms": [{"effect": "gravity", "parameters": {}}]}, "is not in the catalogue"),
        ({"terms": [{"effect": "aero_drag", "parameters": {}}]}, "takes cda"),
        ({"correction": [{"equation": "v_x", "feature": "luck", "coefficient": 1.0}]}, "luck"),
        ({"schema": 2}, "schema"),
        ({"more": 1}, "no such parameter"),
    ],
)
def test_a_bad_model_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict, message: str
) -> None:
    content = {"kind": "stand_in", "schema": 1, "parameters": {"mass": 1500.0}} | change
    model = tmp_path / "model.yaml"
    model.write_text(yaml.safe_dump(content))
    arguments = ["rollout", "--model", str(model), "--bag", str(folder / "heldout")]
    line = refused(capsys, 2, *arguments, "--out", str(tmp_path / "r.csv"))
    assert message in line


def test_a_short_recording_is_refused_and_nothing_is_written(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sensor_log(case().recording.between(0.0, 10.0), tmp_path / "short")
    line = refused(
        capsys,
        3,
        "mismatch",
        "--simulation",
        str(folder / "simulation"),
        "--recording",
        str(tmp_path / "short"),
        "--out",
        str(tmp_path / "report"),
    )
    assert "at least 30 s" in line
    assert not list(tmp_path.glob("report*"))


def test_a_folder_without_cases_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "no case" in refused(capsys, 2, "bench", "concealed", "--cases", str(tmp_path))


def test_a_surrogate_file_keeps_eight_digits() -> None:
    p = default_parameters()
    p[INDEX["mass"]] = 1234.56789
    assert "mass: 1234.5679" in surrogate_yaml(p)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_leaves_no_incomplete_report(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    number: signal.Signals,
) -> None:
    def interrupted_page(result: object, out: Path, *, provenance: object) -> None:
        (out / "map.png").write_bytes(b"incomplete")
        signal.raise_signal(number)

    monkeypatch.setattr("adk_ros.mismatch.analysis.identify_mismatch", lambda *_: drag())
    arguments = ["mismatch", "--simulation", str(folder / "simulation")]
    arguments += ["--recording", str(folder / "recording"), "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    monkeypatch.setattr("adk_ros.mismatch.report.result_files.write_page", interrupted_page)
    assert main([*arguments, "--force"]) == 128 + number
    assert {p.name: p.read_bytes() for p in (tmp_path / "out").iterdir()} == before
    assert main([*arguments[:-1], str(tmp_path / "new")]) == 128 + number
    assert {path.name for path in tmp_path.iterdir()} == {"out"}
    capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--calibrate or --real FOLDER, one of them"),
        (["--own", "--real", "x"], "one of them"),
        (["--own", "--calibrate"], "one of them"),
        (["--own", "--jobs", "0"], "choose 1 to 64"),
        (["--own", "--resume"], "name it"),
        (["--own", "--seed", "499"], "choose 0 to 498"),
        (["--calibrate", "--seed", "1"], "use it with --own"),
        (["--calibrate", "--recordings", "2"], "use it with --own"),
        (["--own", "--recordings", "0"], "choose 1 to 10"),
        (["--calibrate", "--factorial", "payload"], "use it with --own"),
        (["--own", "--factorial", "payload", "--limit", "3"], "runs every combination"),
        (["--own", "--factorial", "payloads"], "no effect is called 'payloads'"),
        (["--real", "x"], "needs --vehicle"),
    ],
)
def test_invalid_bench_options_are_refused(
    capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert message in refused(capsys, 2, "bench", "concealed", *arguments)


def test_bench_results_are_not_replaced_unasked(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("bench", "concealed", "--cases", str(folder.parent), "--out", str(tmp_path))
    (tmp_path / "criteria.txt").write_text("PASS\n")
    assert "holds an earlier result: add --force" in refused(capsys, 2, *arguments)
    # The name of the file in 0.1.0.
    (tmp_path / "criteria.txt").rename(tmp_path / "bars.txt")
    assert "holds an earlier result: add --force" in refused(capsys, 2, *arguments)
    (tmp_path / "bars.txt").rename(tmp_path / "notes.txt")
    assert "holds no earlier result" in refused(capsys, 2, *arguments, "--force")


def test_the_same_bag_twice_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(folder / "recording")
    line = refused(
        capsys,
        2,
        "mismatch",
        "--simulation",
        bag,
        "--recording",
        f"{bag}/../recording",
        "--out",
        str(tmp_path / "out"),
    )
    assert "are the same bag" in line
    assert not (tmp_path / "out").exists()


def test_a_recording_given_twice_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = folder / "recording"
    arguments = ["mismatch", "--simulation", str(folder / "simulation"), "--recording", str(bag)]
    line = refused(
        capsys, 2, *arguments, "--recording", f"{bag}/../recording", "--out", str(tmp_path / "out")
    )
    assert "given twice: give each recording once" in line
    shutil.copytree(bag, tmp_path / "copy")
    line = refused(
        capsys, 3, *arguments, "--recording", str(tmp_path / "copy"), "--out", str(tmp_path / "o")
    )
    assert "recording and copy have the same odometry" in line
    assert not (tmp_path / "out").exists()


def test_a_recording_without_an_imu_needs_an_option(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recording = case().recording
    bag = tmp_path / "odometry"
    write_sensor_log(replace(recording, imu_s=np.empty(0), imu=np.empty((0, 3))), bag)
    monkeypatch.setattr("adk_ros.mismatch.analysis.identify_mismatch", lambda *_: drag())
    arguments = ["mismatch", "--simulation", str(folder / "simulation"), "--recording", str(bag)]
    arguments += ["--out", str(tmp_path / "out")]
    line = refused(capsys, 3, *arguments)
    assert "no IMU" in line
    assert "--without-imu" in line
    assert not (tmp_path / "out").exists()
    assert main([*arguments, "--without-imu"]) == 0
    assert (tmp_path / "out" / "mismatch.json").is_file()
    capsys.readouterr()


def test_calibrations_of_the_car_do_not_hold_for_the_simulation(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gyro: dict[str, FloatArray] = {}

    def reading(
        simulated: SensorLog, recorded: list[SensorLog], *others: object
    ) -> MismatchResult:
        gyro.update(simulation=simulated.imu[:, 2], recording=recorded[0].imu[:, 2])
        return drag()

    monkeypatch.setattr("adk_ros.mismatch.analysis.identify_mismatch", reading)
    params = tmp_path / "params.yaml"
    params.write_text("/**:\n  ros__parameters:\n    gyro_scale: 1.25\n")
    raw = {name: read_sensor_log(folder / name).imu[:, 2] for name in ("simulation", "recording")}
    arguments = ["mismatch", "--simulation", str(folder / "simulation"), "--force"]
    arguments += ["--recording", str(folder / "recording"), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--recording-params", str(params)]) == 0
    np.testing.assert_allclose(gyro["recording"], raw["recording"] / 1.25)
    np.testing.assert_allclose(gyro["simulation"], raw["simulation"])
    assert main([*arguments, "--params", str(params)]) == 0
    np.testing.assert_allclose(gyro["recording"], raw["recording"] / 1.25)
    np.testing.assert_allclose(gyro["simulation"], raw["simulation"] / 1.25)


def test_an_earlier_report_is_replaced_only_with_force(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("adk_ros.mismatch.analysis.identify_mismatch", lambda *_: drag())
    out = tmp_path / "out"
    arguments = ["mismatch", "--simulation", str(folder / "simulation")]
    arguments += ["--recording", str(folder / "recording"), "--out", str(out)]
    assert main(arguments) == 0
    capsys.readouterr()
    assert "add --force to replace it" in refused(capsys, 2, *arguments)
    (out / "notes.txt").write_text("kept")
    assert main([*arguments, "--force"]) == 0
    assert (out / "notes.txt").read_text() == "kept"
    capsys.readouterr()


def test_a_question_for_an_unknown_effect_is_refused_with_close_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = ["--simulation", str(tmp_path / "no"), "--recording", str(tmp_path / "none")]
    arguments = ["mismatch", *bags, "--out", str(tmp_path / "out"), "--ask", "aero_drag"]
    line = refused(capsys, 2, *arguments, "--ask", "steering-lga")
    assert "--ask steering-lga: no such effect" in line
    assert "steering_lag" in line
    assert "effects.md" in line


def test_answers_follow_the_summary(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def answering(*arguments: object) -> MismatchResult:
        assert arguments[-1] == ["imu_delay", "headwind", "payload"]
        hidden = AskedEffect("imu_delay", False, "the channels of this recording do not show it")
        return replace(drag(), asked=[hidden])

    monkeypatch.setattr("adk_ros.mismatch.analysis.identify_mismatch", answering)
    arguments = ["mismatch", "--simulation", str(folder / "simulation"), "--ask", "imu_delay"]
    arguments += ["--ask", "headwind, payload"]
    arguments += ["--recording", str(folder / "recording"), "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    printed = capsys.readouterr()
    said = " ".join(printed.out.split())
    assert f"{folder / 'recording'} against simulation" in " ".join(printed.err.split())
    assert said.endswith(
        "IMU delay is not claimed: the channels of this recording do not show it."
    )
