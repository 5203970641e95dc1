# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
SIGKILL at random moments of training, replay and mismatch analysis, and of the node's start.

Nothing half-written is taken for whole afterwards, and the same command then succeeds. Half of
the moments lie anywhere in a run, half after its first file has appeared. `KILLS` is the number
of moments in all.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from helpers.fuzzing import SEED
from helpers.mismatch import case
from helpers.node import running_node, write_bag, write_model

from adk_ros.bags import Bag
from adk_ros.bench.mismatch.case_files import write_case
from adk_ros.errors import AdkError
from adk_ros.model import artefact

pytestmark = pytest.mark.slow(seconds=120)
KILLS = int(os.environ.get("KILLS", "8"))
PARTS = 4
"""Tests that share the moments."""
_START_S = 900.0
"""s after which a node that has not started hangs. On a busy machine it compiles for minutes."""


@dataclass
class Command:
    """An `adk` command that writes to `out`, which lies in a folder of its own."""

    arguments: list[str]
    out: Path
    seconds: float = 0.0
    """Duration of an undisturbed run, s."""
    writes_s: float = 0.0
    """Time of the first file, s."""

    def run(self, kill_after_s: float | None = None, *more: str) -> int | None:
        """Run the command; return its exit code, None if it was killed."""
        process = subprocess.Popen(
            [sys.executable, "-m", "adk_ros.cli.main", *self.arguments, *more],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            return process.wait(kill_after_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return None

    def measure(self) -> None:
        """Run undisturbed; note how long it takes and when it begins to write."""
        begin_s = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-m", "adk_ros.cli.main", *self.arguments],
            stdout=subprocess.DEVNULL,
        )
        before = set(os.listdir(self.out.parent))
        while process.poll() is None:
            if not self.writes_s and set(os.listdir(self.out.parent)) != before:
                self.writes_s = time.monotonic() - begin_s
            time.sleep(0.005)
        assert process.returncode == 0
        self.seconds = time.monotonic() - begin_s


def kill(command: Command, is_whole: Callable[[Path], bool]) -> None:
    """
    Kill a command at its share of the moments, half of them over what is there from before.

    `is_whole` says whether a result is there, and fails if half of one is taken for whole. At the
    end the command must succeed.
    """
    command.measure()
    assert is_whole(command.out)
    moments = random.Random(SEED)
    for i in range(max(2, KILLS // PARTS)):
        from_s = command.writes_s if i % 2 else 0.0
        if i % 4 > 1:
            shutil.rmtree(command.out, ignore_errors=True)
        replacing = ["--force"] if command.out.exists() else []
        ended = command.run(moments.uniform(from_s, command.seconds), *replacing)
        whole = is_whole(command.out)
        assert whole or ended != 0
        if whole:
            assert command.run() == 2, "an earlier result was replaced unasked"
    assert command.run(None, "--force") == 0
    assert is_whole(command.out)


def test_training(tmp_path: Path) -> None:
    recording = write_bag(tmp_path / "recording", 60.0)
    out = tmp_path / "out" / "model"
    out.parent.mkdir()

    def is_whole(path: Path) -> bool:
        try:
            artefact.load(path)
        except AdkError:
            return False
        page = path / "report.html"
        assert not page.exists() or page.read_text().rstrip().endswith("</html>")
        return True

    command = Command(["train", str(recording), "--out", str(out), "--steps", "40"], out)
    kill(command, is_whole)


def test_replay(tmp_path: Path) -> None:
    recording = write_bag(tmp_path / "recording", 30.0)
    model = write_model(tmp_path / "model")
    out = tmp_path / "out" / "predicted"
    out.parent.mkdir()
    counts = set()

    def is_whole(path: Path) -> bool:
        try:
            with Bag(path) as bag:
                messages = sum(1 for _ in bag.messages())
                if bag.warnings:
                    return False
        except AdkError:
            return False
        counts.add(messages)
        return True

    command = Command(["replay", str(recording), "--model", str(model), "--out", str(out)], out)
    kill(command, is_whole)
    assert len(counts) == 1


def test_mismatch(tmp_path: Path) -> None:
    inputs = tmp_path / "case"
    write_case(case("aero_drag", cda=1.0), inputs)
    out = tmp_path / "out" / "report"
    out.parent.mkdir()
    files: set[str] = set()

    def is_whole(path: Path) -> bool:
        result = path / "mismatch.json"
        if not result.exists():
            return False
        json.loads(result.read_text())
        found = {item.name for item in path.iterdir() if not item.name.startswith(".")}
        files.update(found)
        assert found == files, "a result without its other files"
        assert (path / "report.html").read_text().rstrip().endswith("</html>")
        return True

    arguments = ["mismatch", "--out", str(out), "--vehicle", str(inputs / "vehicle.yaml")]
    for name in ("simulation", "recording"):
        arguments += [f"--{name}", str(inputs / name)]
    kill(Command(arguments, out), is_whole)


def test_node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A node that was killed while it compiled starts from the same cache."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    model = write_model(tmp_path / "model")
    moments = random.Random(SEED)
    for _ in range(max(2, KILLS // PARTS)):
        with running_node(model=str(model)):
            time.sleep(moments.uniform(1.0, 15.0))
    with running_node(model=str(model)) as node:
        assert node.process.stderr is not None
        hangs = threading.Timer(_START_S, node.process.kill)
        hangs.start()
        try:
            for line in node.process.stderr:
                assert "Traceback" not in line
                if "model_hash" in line:
                    break
            else:
                pytest.fail(f"the node ended with {node.process.wait()}")
        finally:
            hangs.cancel()
        assert node.end()[0] == 0
