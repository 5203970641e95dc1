# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Export of bags and reports: what is written can be imported again; layouts name what exists."""

from __future__ import annotations

import json
import math
import shutil
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml
from helpers.mismatch_report import result_of
from helpers.train import bag, refused
from scipy.io import loadmat

from adk_ros.api.exporting import export
from adk_ros.api.importing import import_recording, propose_map
from adk_ros.api.kernel_calls import _small_surrogate
from adk_ros.bags import Bag
from adk_ros.bags.recording import read_recording
from adk_ros.cli.main import main
from adk_ros.exporting.bag_channels import _imu_rest
from adk_ros.exporting.report_signals import ROLES
from adk_ros.files.pages.provenance import Provenance, input_files
from adk_ros.importing.parquet_file import read_parquet_table
from adk_ros.mismatch.inference.signal_fit import SIGNALS
from adk_ros.mismatch.report.result_files import write_report
from adk_ros.signals.channels import Record
from adk_ros.signals.decode import SensorConfig

SECONDS = 12.0


def same(first: Record, second: Record) -> None:
    for name in ("stamp_ns", "x", "u", "a", "flags", "x_ref", "episode"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), name)


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat"])
def test_an_exported_bag_is_imported_as_the_same_record(tmp_path: Path, kind: str) -> None:
    source, file = bag("town", SECONDS), tmp_path / f"town.{kind}"
    result = export(source, kind, file)
    assert result.columns["v_x"] == "m/s"
    # The proposed map is complete: names and units are those of the export.
    (tmp_path / "map.yaml").write_text(propose_map(file).text)
    imported = import_recording(file, tmp_path / "map.yaml", tmp_path / "again")
    assert imported.not_imported == {}
    same(read_recording(source).record, read_recording(tmp_path / "again").record)


def test_units_are_in_the_names_and_in_the_structure(tmp_path: Path) -> None:
    export(bag("town", SECONDS), "csv", tmp_path / "a.csv")
    frame = pd.read_csv(tmp_path / "a.csv")
    assert {"stamp_ns", "time_s", "v_x [m/s]", "yaw_rate [rad/s]", "torque [N m]"} <= set(frame)
    assert frame["stamp_ns"].is_monotonic_increasing
    export(bag("town", SECONDS), "mat", tmp_path / "a.mat")
    content = loadmat(tmp_path / "a.mat", squeeze_me=True, struct_as_record=False)
    assert content["units"].odometry.v_x == "m/s"
    assert content["odometry"].v_x.shape == content["odometry"].time_s.shape


def test_mcap_is_a_recording_and_its_layouts_name_its_topics(tmp_path: Path) -> None:
    source, out = bag("town", SECONDS), tmp_path / "view"
    result = export(source, "mcap", out)
    same(read_recording(source).record, read_recording(out).record)
    check_layouts(out, result.layouts)


def value_at(msg, path: str) -> float:
    for part in path.replace("[", ".[").split("."):
        msg = msg[int(part[1:-1])] if part.startswith("[") else getattr(msg, part)
    return float(msg)


def plotjuggler_curve(value: str, messages: dict) -> str:
    """Return the name that PlotJuggler gives a path of Foxglove: joints by their name."""
    topic, _, field = value.partition(".")
    msg = messages[topic]
    if hasattr(msg, "effort"):
        name, _, index = field.partition("[")
        return f"{topic}/{msg.name[int(index[:-1])]}/{name}"
    return f"{topic}/{field.replace('.', '/')}"


def check_layouts(out: Path, layouts: tuple[Path, ...]) -> list[str]:
    """Require that each curve of both layouts is a number of a message; return the curves."""
    with Bag(out) as opened:
        messages = {topic: msg for topic, _, msg in opened.messages()}
    foxglove, plotjuggler = layouts
    content = json.loads(foxglove.read_text())
    panels = content["configById"]
    shown = [
        path["value"]
        for name, panel in panels.items()
        if name.startswith("Plot!")
        for path in panel["paths"]
    ]
    assert shown
    for value in shown:
        topic, _, field = value.partition(".")
        assert np.isfinite(value_at(messages[topic], field)), value
    tabs = panels[content["layout"]]["tabs"]
    named = json.dumps([tab["layout"] for tab in tabs])
    assert all(f'"{name}"' in named for name in panels if name.startswith("Plot!"))
    root = ElementTree.parse(plotjuggler).getroot()
    curves = [element.get("name") or "" for element in root.iter("curve")]
    assert curves == [plotjuggler_curve(value, messages) for value in shown]
    (loaded,) = root.iter("fileInfo")
    assert loaded.get("filename") == f"{out.name}/{out.name}.mcap"
    assert (out.parent / f"{out.name}/{out.name}.mcap").is_file()
    splitters = list(root.iter("DockSplitter"))
    assert all(int(x.get("count", "0")) == len(x.findall("DockArea")) for x in splitters)
    return curves


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a report of one recording, whose models are those of a packaged vehicle."""
    folder = tmp_path_factory.mktemp("report")
    recording = folder / "real"
    shutil.copytree(bag("town", SECONDS), recording)
    content = _small_surrogate().content.model_dump(by_alias=True, exclude_defaults=True)
    text = yaml.safe_dump({"kind": "surrogate", "schema": 2} | content)
    heavier = content | {"parameters": content["parameters"] | {"mass": 1900.0}}
    other = yaml.safe_dump({"kind": "surrogate", "schema": 2} | heavier)
    result = replace(result_of(), simulation_yaml=text, corrected_yaml=other)
    inputs = input_files("recording", recording)
    about = Provenance("adk mismatch", "0.1.0", "2026-01-01", 1.0, inputs)
    write_report(result, folder / "report", provenance=about)
    return folder / "report"


def test_a_report_gives_measured_simulated_corrected_and_residuals(
    tmp_path: Path, report: Path
) -> None:
    result = export(report, "csv", tmp_path / "a.csv")
    assert result.warnings == []
    frame = pd.read_csv(tmp_path / "a.csv")
    assert len(frame) == result.rows > 80
    assert set(result.columns) == {f"{x}_{role}" for x in SIGNALS for role in ROLES}
    for signal, unit in (("v_x", "m/s"), ("a_y", "m/s^2")):
        measured = frame[f"{signal}_measured [{unit}]"]
        for role in ("simulated", "corrected"):
            residual = frame[f"{signal}_residual_{role} [{unit}]"]
            predicted = frame[f"{signal}_{role} [{unit}]"]
            np.testing.assert_allclose(measured - predicted, residual, atol=1e-12)
    # Two models, measured within the recording: 1 s ahead both are near.
    assert frame["v_x_residual_simulated [m/s]"].abs().median() < 1.0
    difference = frame["v_x_simulated [m/s]"] - frame["v_x_corrected [m/s]"]
    assert difference.abs().max() > 1e-3
    record = read_recording(report.parent / "real").record
    measured = np.interp(frame["stamp_ns"], record.stamp_ns, record.x_ref[:, 0])
    np.testing.assert_allclose(frame["v_x_measured [m/s]"], measured, atol=0.1)


@pytest.mark.parametrize("kind", ["parquet", "mat", "mcap"])
def test_a_report_in_other_formats(tmp_path: Path, report: Path, kind: str) -> None:
    out = tmp_path / f"a.{kind}"
    result = export(report, kind, out)
    if kind == "mcap":
        curves = check_layouts(out, result.layouts)
        assert "/v_x/measured/data" in curves
        assert "/yaw_rate/residual_corrected/data" in curves
    elif kind == "parquet":
        assert len(read_parquet_table(out).load(["stamp_ns"])["stamp_ns"]) == result.rows
    else:
        content = loadmat(out, squeeze_me=True, struct_as_record=False)
        assert content["signals"].v_x_measured.shape == (result.rows,)


def test_what_a_report_lacks_is_said_in_one_line(capsys, tmp_path: Path, report: Path) -> None:
    moved = tmp_path / "moved"
    shutil.copytree(report, moved)
    page = moved / "report.html"
    page.write_text(page.read_text().replace(str(report.parent / "real"), "/nowhere/real"))
    arguments = ["export", moved, "--to", "csv", "--out", tmp_path / "a.csv"]
    assert "is not there: give --recording BAG" in refused(capsys, arguments, 2)
    real = report.parent / "real"
    assert main([str(x) for x in [*arguments, "--recording", real]]) == 0
    assert "rows, 25 channels in" in capsys.readouterr().err
    page.unlink()
    again = [*arguments, "--force"]
    assert "does not name its recording: give --recording" in refused(capsys, again, 2)
    (moved / "corrected.yaml").unlink()
    line = refused(capsys, [*again, "--recording", real], 2)
    assert "lacks corrected.yaml" in line


def test_a_changed_recording_is_reported(tmp_path: Path, report: Path) -> None:
    copied = tmp_path / "copy"
    shutil.copytree(report, copied)
    page = copied / "report.html"
    text = page.read_text()
    digest = input_files("recording", report.parent / "real")[0].sha256
    page.write_text(text.replace(digest, "0" * 64))
    result = export(copied, "csv", tmp_path / "a.csv")
    assert any("has changed since" in warning for warning in result.warnings)


def test_wrong_arguments_are_refused(capsys, tmp_path: Path) -> None:
    source, out = bag("town", SECONDS), tmp_path / "a.csv"
    arguments = ["export", source, "--to", "csv", "--out", out]
    assert "--to xlsx is unknown: choose one of csv" in refused(
        capsys, ["export", source, "--to", "xlsx", "--out", out], 2
    )
    assert "--recording is for reports only" in refused(
        capsys, [*arguments, "--recording", source], 2
    )
    assert "does not exist" in refused(
        capsys, ["export", tmp_path / "no", "--to", "csv", "--out", out], 2
    )
    assert main([str(x) for x in [*arguments, "--json"]]) == 0
    assert json.loads(capsys.readouterr().out)["columns"]["delta"] == "rad"
    assert "add --force to replace it" in refused(capsys, arguments, 2)


def test_all_axes_of_a_turned_imu_are_those_of_the_vehicle() -> None:
    """Upside down, in g and degrees, on a slope of 0.1 rad: as decoded, like a_y and yaw rate."""
    sensors = SensorConfig(
        imu_rotation=(math.pi, 0.0, 0.0), accelerometer_scale=1 / 9.81, gyro_scale=180 / math.pi
    )
    half = 0.05
    # Down by 0.1 rad about y, and turned upside down about x.
    q = SimpleNamespace(w=0.0, x=math.cos(half), y=0.0, z=-math.sin(half))
    message = SimpleNamespace(
        linear_acceleration=SimpleNamespace(x=0.0, y=0.0, z=-1.0),
        angular_velocity=SimpleNamespace(x=1.0, y=2.0, z=3.0),
        linear_acceleration_covariance=[0.0] * 9,
        angular_velocity_covariance=[0.0] * 9,
        orientation=q,
        orientation_covariance=[0.0] * 9,
    )
    found = _imu_rest(message, sensors)
    assert found["a_z"] == pytest.approx(9.81)
    assert found["roll_rate"] == pytest.approx(math.radians(1.0))
    assert found["pitch_rate"] == pytest.approx(-math.radians(2.0))
    assert found["roll"] == pytest.approx(0.0, abs=1e-9)
    assert found["pitch"] == pytest.approx(0.1)
