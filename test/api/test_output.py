# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Existing output: refused before the work starts, replaced only with `force`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.mismatch_report import drag
from helpers.train import bag, small

import adk_ros
from adk_ros.api import explain as explain_module
from adk_ros.api.output import bag_files, check_output, remove_earlier_bag
from adk_ros.api.training import check_training
from adk_ros.cli.demonstration import MARKER, _claim_folder
from adk_ros.cli.main import main

pytestmark = pytest.mark.usefixtures("unrendered")


def replay(out: Path, force: bool) -> object:
    return adk_ros.replay(bag("town", 10.0), small().path, out=out, force=force)


def simulate(out: Path, force: bool) -> object:
    return adk_ros.simulate("town", out, duration_s=2.0, force=force)


WRITERS: list[Callable[[Path, bool], object]] = [replay, simulate]


@pytest.mark.parametrize("write", WRITERS, ids=lambda write: write.__name__)
def test_a_bag_is_replaced_only_with_force(
    write: Callable[[Path, bool], object], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    write(out, False)
    before = {path.name: path.stat().st_mtime_ns for path in out.iterdir()}
    with pytest.raises(adk_ros.UsageError, match="add --force"):
        write(out, False)
    assert {path.name: path.stat().st_mtime_ns for path in out.iterdir()} == before
    write(out, True)
    assert {path.name for path in out.iterdir()} == set(before)
    (out / "thesis.txt").write_text("kept")
    with pytest.raises(adk_ros.UsageError, match="holds more than a bag"):
        write(out, True)
    assert (out / "thesis.txt").read_text() == "kept"
    assert set(before) < {path.name for path in out.iterdir()}


def test_force_does_not_replace_other_folders(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("kept")
    for write in WRITERS:
        with pytest.raises(adk_ros.UsageError, match="no earlier result"):
            write(tmp_path, True)
    with pytest.raises(adk_ros.UsageError, match="no earlier result"):
        adk_ros.train_model("absent", out=tmp_path, force=True)
    with pytest.raises(adk_ros.UsageError, match="no earlier result"):
        adk_ros.explain("absent", "absent_too", out=tmp_path, force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize("write", WRITERS, ids=lambda write: write.__name__)
def test_a_bag_that_a_killed_process_left_is_replaced_with_force(
    write: Callable[[Path, bool], object], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    write(out, False)
    (out / "metadata.yaml").unlink()
    with pytest.raises(adk_ros.AdkError, match="add --force to replace it"):
        write(out, False)
    write(out, True)
    assert (out / "metadata.yaml").exists()


def test_recordings_without_metadata_are_not_removed(tmp_path: Path) -> None:
    out = tmp_path / "drives"
    out.mkdir()
    for name in ("drives.mcap", "drives_1.mcap"):
        (out / name).write_bytes(b"x")
    with pytest.raises(adk_ros.AdkError, match=r"holds more than a bag \(drives_1.mcap\)"):
        simulate(out, True)
    assert len(list(out.iterdir())) == 2


def test_an_input_is_never_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "drive.mcap"
    file.write_bytes(b"measured")
    with pytest.raises(adk_ros.UsageError, match="is an input as well"):
        check_output(tmp_path / "." / "drive.mcap", True, None, file)
    # A bag is replaced as a whole, with the file of it that is read.
    with pytest.raises(adk_ros.UsageError, match="is an input as well"):
        check_output(tmp_path, True, bag_files(tmp_path), file)
    assert file.read_bytes() == b"measured"


def test_a_folder_inside_a_bag_is_not_removed(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("x: 1")
    (tmp_path / "more.mcap").mkdir()
    with pytest.raises(adk_ros.UsageError, match="holds more than a bag"):
        remove_earlier_bag(tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


def test_training_arguments_are_checked_before_a_bag_is_read(tmp_path: Path) -> None:
    with pytest.raises(adk_ros.UsageError, match="split 'rows' is unknown"):
        adk_ros.train_model("absent", out=tmp_path / "m", split="rows")
    with pytest.raises(adk_ros.UsageError, match="at least two bags"):
        adk_ros.train_model("absent", out=tmp_path / "m", split="bags")
    with pytest.raises(adk_ros.UsageError, match="either settings, or steps"):
        adk_ros.train_model(
            "absent", out=tmp_path / "m", steps=10, settings=adk_ros.TrainSettings()
        )
    with pytest.raises(adk_ros.UsageError, match="holds an earlier result: add --force"):
        adk_ros.train_model("absent", out=small().path)
    check_training(small().path, "blocks", 1, force=True)


def test_an_explanation_is_replaced_only_with_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    explanation = explain_module.MismatchExplanation(drag(), [])
    out = tmp_path / "report"
    explanation.write(out)
    assert json.loads((out / "mismatch.json").read_text())["verdict"] == explanation.verdict
    with pytest.raises(adk_ros.UsageError, match="add --force"):
        explanation.write(out)
    with pytest.raises(adk_ros.UsageError, match="add --force"):
        adk_ros.explain("absent", "absent_too", out=out)
    explanation.write(out, force=True)


def test_tables_of_an_explanation() -> None:
    explanation = explain_module.MismatchExplanation(drag(), ["warning"])
    content = explanation.as_dict()
    assert explanation.summary == content["sentence"]
    row = explanation.effects.loc[("aero_drag", "cda")]
    expected = content["effects"][0]["parameters"]["cda"]
    assert (row["value"], row["low"], row["high"]) == tuple(
        expected[name] for name in ("value", "low", "high")
    )
    assert row["confidence"] == content["effects"][0]["confidence"]
    errors = explanation.errors
    assert dict(errors["simulation"]) == content["fit"]["before"]
    assert dict(errors["corrected"]) == content["fit"]["after"]
    assert list(errors["unit"]) == ["m/s", "m/s", "rad/s"]
    assert [len(figure.axes) for figure in explanation.figures.values()] == [6, 3]
    assert "<table" in explanation._repr_html_()


def test_the_demo_replaces_only_an_earlier_demo(tmp_path: Path) -> None:
    out = tmp_path / "demo_out"
    for _ in range(2):
        _claim_folder(out, bag(), bag(), 10)
        (out / "predicted").mkdir(exist_ok=True)
        (out / "predicted" / "metadata.yaml").write_text("x: 1")
    assert (out / MARKER).is_file()
    (out / "predicted" / "thesis.txt").write_text("kept")
    with pytest.raises(adk_ros.UsageError, match="holds more than a bag"):
        remove_earlier_bag(out / "predicted")
    (out / MARKER).unlink()
    with pytest.raises(adk_ros.UsageError, match="no earlier result"):
        _claim_folder(out, bag(), bag(), 10)


def test_the_verbs_replace_with_force(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file, folder = tmp_path / "r.csv", tmp_path / "b"
    rollout = ["rollout", "--model", "imdv", "--bag", str(bag("town", 10.0)), "--out", str(file)]
    simulated = ["simulate", "town", "--duration", "2", "--out", str(folder)]
    predicted = ["replay", str(bag("town", 10.0)), "--model", str(small().path)]
    predicted += ["--out", str(tmp_path / "p")]
    for arguments in (rollout, simulated, predicted):
        assert main(arguments) == 0
        capsys.readouterr()
        assert main(arguments) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert "add --force to replace it" in printed.err
        assert main([*arguments, "--force"]) == 0
        capsys.readouterr()


def test_force_keeps_what_lies_beside_a_bag(tmp_path: Path) -> None:
    """A map of the import, or the parameters that adk check proposed."""
    for name in ("metadata.yaml", "drive_0.mcap", "map.yaml"):
        (tmp_path / name).touch()
    with pytest.raises(adk_ros.UsageError, match=r"holds more than a bag \(map.yaml\)"):
        remove_earlier_bag(tmp_path)
    assert (tmp_path / "drive_0.mcap").exists()


def test_a_wrong_storage_removes_no_bag(tmp_path: Path) -> None:
    out = tmp_path / "drive"
    adk_ros.simulate("handling", out, duration_s=2.0)
    before = sorted(path.name for path in out.iterdir())
    with pytest.raises(adk_ros.UsageError, match="storage 'foo' is unknown"):
        adk_ros.simulate("handling", out, duration_s=2.0, storage="foo", force=True)
    assert sorted(path.name for path in out.iterdir()) == before
