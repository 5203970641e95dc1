# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk simulate: reproducible scenarios as bags; and verbs started under their own names."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.train import bag, drive, lines, refused

from adk_ros.bags import Bag
from adk_ros.bags.recording import read_recording
from adk_ros.cli import main as cli
from adk_ros.cli.main import main
from adk_ros.plant.scenario.scenario_file import scenarios


def contents(path: Path) -> list[tuple[str, str, int, bytes]]:
    with Bag(path) as opened:
        assert opened.warnings == []
        return list(opened.raw())


def simulated(capsys: pytest.CaptureFixture[str], out: Path, *more: str) -> str:
    arguments = ["simulate", "town", "--out", str(out), "--duration", "10", *more]
    assert main(arguments) == 0
    printed = capsys.readouterr()
    return printed.out if "--json" in more else printed.err


def test_the_bag_contains_the_messages_of_the_sensors(capsys, tmp_path: Path) -> None:
    out = tmp_path / "town"
    printed = simulated(capsys, out)
    seed = drive("town", 10.0).seed
    assert lines(printed) == [f"10 s of town, seed {seed}: {out}"]
    assert contents(out) == contents(bag("town", 10.0))


@pytest.mark.parametrize("how", [("sqlite3", "none"), ("sqlite3", "zstd"), ("mcap", "none")])
def test_all_storages_contain_the_same_messages(
    capsys, tmp_path: Path, how: tuple[str, str]
) -> None:
    simulated(capsys, tmp_path / "b", "--storage", how[0], "--compression", how[1])
    assert contents(tmp_path / "b") == contents(bag("town", 10.0))


def test_json_and_another_seed(capsys, tmp_path: Path) -> None:
    out = tmp_path / "b"
    printed = json.loads(simulated(capsys, out, "--seed", "9", "--json"))
    assert printed == {
        "scenario": "town", "seed": 9, "seconds": 10.0, "messages": len(contents(out)),
        "out": str(out),
    }  # fmt: skip
    other, default = read_recording(out).record, read_recording(bag("town", 10.0)).record
    assert np.abs(other.x_ref[100:300] - default.x_ref[100:300]).max() > 0.05


def test_a_scenario_file(capsys, tmp_path: Path) -> None:
    file = tmp_path / "square.yaml"
    file.write_text(
        "duration_s: 5.0\nroute:\n"
        + "  - straight: 60\n  - bend: {radius: 20, angle_deg: 90, transition: 8}\n" * 4
    )
    arguments = ["simulate", str(file), "--out", str(tmp_path / "b")]
    assert main(arguments) == 0
    assert "5 s of square, seed 0" in capsys.readouterr().err
    file.write_text("duration_s: 5.0\nroute: [straight: 60]\nspeeed: 3\n")
    line = refused(capsys, [*arguments[:-1], str(tmp_path / "c")], 2)
    assert "square.yaml: speeed: no such parameter" in line


def test_invalid_options_are_refused(capsys, tmp_path: Path) -> None:
    arguments = ["simulate", "town", "--out", tmp_path / "b", "--duration", "2"]
    assert "storage 'tape' is unknown" in refused(capsys, [*arguments, "--storage", "tape"], 2)
    assert "compression 'lzw'" in refused(capsys, [*arguments, "--compression", "lzw"], 2)
    assert "seed must not be negative" in refused(capsys, [*arguments, "--seed", "-1"], 2)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "notes.txt").touch()
    assert "no earlier result" in refused(capsys, arguments, 2)


def test_each_verb_has_an_entry_point(capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    """The case of `ros2 run adk_ros info ...`."""
    monkeypatch.setattr(sys, "argv", ["/opt/ws/lib/adk_ros/info", str(bag("town", 10.0))])
    assert cli.info_main() == 0
    said = capsys.readouterr().out
    assert "not usable for training or replay: the car moves for 10 s only" in said
    for verb in ("train", "replay", "play", "echo", "rollout", "info", "simulate", "bench"):
        monkeypatch.setattr(sys, "argv", [f"/opt/ws/lib/adk_ros/{verb}", "--help"])
        assert getattr(cli, f"{verb}_main")() == 0
        assert capsys.readouterr().out.startswith(f"Usage: adk {verb} ")


def test_help_names_every_scenario(capsys) -> None:
    assert main(["simulate", "--help"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in scenarios())
