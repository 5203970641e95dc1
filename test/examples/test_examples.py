# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scripts in examples/ run on the sample bags and write what they say."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.train import small

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def run(name: str, out: Path, *arguments: object) -> str:
    """Run an example in a process of its own, from another folder; return what it prints."""
    process = subprocess.run(
        [sys.executable, str(EXAMPLES / name), "--out", str(out), *map(str, arguments)],
        cwd=out.parent,
        capture_output=True,
        text=True,
        check=False,
        timeout=580,
    )
    assert process.returncode == 0, process.stderr
    return process.stdout


@pytest.mark.slow(seconds=120)
def test_predict(tmp_path: Path) -> None:
    out = tmp_path / "out"
    printed = run("01_predict.py", out, "--steps", 20)
    assert "RMSE divided by that of the best naive predictor" in printed
    assert {path.name for path in out.iterdir()} == {
        "model",
        "predicted_1s_ahead.png",
        "held_out_errors.png",
    }
    assert "warning" not in printed


@pytest.mark.slow(seconds=10)
def test_rollout_and_compare(tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ("--model", small().path, "--horizon", "1")
    printed = run("02_rollout_and_compare.py", out, *arguments)
    assert "simulation (imdv)" in printed
    assert {path.name for path in out.iterdir()} == {"rollouts.png", "rollouts.csv"}


@pytest.mark.slow(seconds=120)
def test_explain_a_mismatch(tmp_path: Path) -> None:
    out = tmp_path / "out"
    printed = run("03_explain_a_mismatch.py", out)
    assert "drag" in printed
    errors = {
        line.split(":")[0]: float(line.split()[-2])
        for line in printed.splitlines()
        if ".yaml: RMSE" in line
    }
    assert errors["corrected.yaml"] < 0.5 * errors["simulation.yaml"]
    assert (out / "report" / "report.html").is_file()


def test_every_example_is_tested_and_listed() -> None:
    scripts = {path.name for path in EXAMPLES.glob("*.py")}
    tested = Path(__file__).read_text(encoding="utf-8")
    listed = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert len(scripts) >= 3
    assert all(f'"{name}"' in tested and f"({name})" in listed for name in scripts)


@pytest.mark.slow(seconds=120)
def test_predict_under_a_plan(tmp_path: Path) -> None:
    printed = run("04_predict_under_a_plan.py", tmp_path / "out", "--model", small().path)
    held, planned = (
        float(re.search(rf"{name}: v_x ([0-9.]+) m/s", printed)[1])  # type: ignore[index]
        for name in ("commands held", "under the plan")
    )
    assert planned < 0.5 * held


@pytest.mark.slow(seconds=10)
def test_follow_a_path(tmp_path: Path) -> None:
    out = tmp_path / "out"
    printed = run("05_follow_a_path.py", out, "--model", small().path, "--duration", 6)
    assert float(re.search(r"RMS ([0-9.]+) m", printed)[1]) < 1.0  # type: ignore[index]
    assert {path.name for path in out.iterdir()} == {"followed_path.png"}
