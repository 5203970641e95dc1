# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk detectable on a bag, and its errors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers.mismatch import case

from adk_ros.bench.mismatch.case_files import write_case
from adk_ros.cli.main import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cases") / "clean"
    write_case(case(), path)
    return path


@pytest.mark.parametrize(
    "arguments",
    [["--noise", "0.1"], ["--noise", "a,b"], ["--minutes", "-1"], ["--minutes", "two"]],
)
def test_wrong_numbers_are_refused(
    arguments: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["detectable", "--simulation", str(folder / "simulation"), *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert arguments[0].strip("-") in line


@pytest.mark.slow
def test_every_effect_has_a_size(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "sizes.csv"
    given = ["--simulation", str(folder / "simulation"), "--vehicle", str(folder / "vehicle.yaml")]
    given += ["--recording", str(folder / "recording"), "--minutes", "5", "--out", str(out)]
    assert main(["detectable", *given, "--json"]) == 0
    rows = {(row["effect"], row["parameter"]): row for row in json.loads(capsys.readouterr().out)}
    assert 0.03 < rows["aero_drag", "cda"]["size"] < 0.3
    assert rows["aero_drag", "cda"]["unit"] == "m^2"
    assert out.read_text().startswith("effect,parameter,minutes,size,unit,limit")
