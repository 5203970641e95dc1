# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A run of the paper's tables that is stopped half-way leaves nothing: no process, no report."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.train import lines

from adk_ros.bench.paper import paper_bench as runs
from adk_ros.cli.main import main
from adk_ros.files.output_folder import staged_folder
from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown

LIMIT_S = 120.0

SCRIPT = """
import sys, tempfile
from pathlib import Path
from adk_ros.bench.paper.cases import Durations
from adk_ros.bench.paper.ending import TERMINATED, Terminated, unwinding
from adk_ros.bench.paper.jobs import Job, Plan
from adk_ros.bench.paper.run import _Pool

if __name__ == "__main__":
    plan = Plan(tests=("nominal",), durations=Durations(train=20.0, test=8.0))
    try:
        with (
            unwinding(), tempfile.TemporaryDirectory(prefix="adk_paper_") as folder,
            _Pool(plan, Path(folder), 2) as pool,
        ):
            pool.run([Job("simulate", about="nominal")], "simulating", None, None)
            pool.run([Job("peers"), Job("peers", "noisy")], "predicting", None, None)
    except Terminated:
        sys.exit(TERMINATED)
    except KeyboardInterrupt:
        sys.exit(130)
"""

PEER = """#!/bin/sh
echo $$ >> {pids}
exec sleep 1000
"""


class Run:
    """A run whose peers never answer, in a session of its own, with its temporary files here."""

    def __init__(self, folder: Path) -> None:
        self.temporary = folder / "tmp"
        self.temporary.mkdir()
        self._pids = folder / "pids"
        python, script = folder / "python", folder / "script.py"
        python.write_text(PEER.format(pids=self._pids))
        python.chmod(0o755)
        script.write_text(SCRIPT)
        environment = os.environ | {
            "TMPDIR": str(self.temporary), "ADK_PEERS_PYTHON": str(python),
        }  # fmt: skip
        # Not pytest's own terminal: Ctrl-C goes to a whole group.
        self.process = subprocess.Popen(
            [sys.executable, str(script)],
            env=environment,
            start_new_session=True,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.until(lambda: len(self.peers()) == 2)

    def peers(self) -> list[int]:
        """Return the peers' processes so far."""
        return [int(line) for line in lines(self._pids.read_text())] if self._pids.exists() else []

    def alive(self) -> list[str]:
        """Return what runs in its session, the dead that nobody has asked for left out."""
        found = []
        for place in Path("/proc").glob("[0-9]*/stat"):
            try:
                name, _, rest = place.read_text().rpartition(")")
            except OSError:
                continue
            state, _, _, session = rest.split()[:4]
            if int(session) == self.process.pid and state != "Z":
                found.append(name)
        return found

    def until(self, reached: object) -> None:
        """Wait for something to be so."""
        assert callable(reached)
        end = time.monotonic() + LIMIT_S
        while not reached():
            assert time.monotonic() < end, self.alive()
            time.sleep(0.05)

    def left(self) -> list[str]:
        """Return the run's folders that are still there."""
        return [path.name for path in self.temporary.iterdir() if path.name.startswith("adk_")]


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Run]:
    """A run that is at its peers."""
    run = Run(tmp_path)
    yield run
    if run.process.poll() is None:
        os.killpg(run.process.pid, signal.SIGKILL)
    run.process.communicate()


def test_sigterm_ends_workers_and_peers_and_removes_the_folders(started: Run) -> None:
    assert len(started.left()) == 1
    started.process.terminate()
    _, said = started.process.communicate(timeout=LIMIT_S)
    assert started.process.returncode == TERMINATED == 143
    assert started.left() == []
    started.until(lambda: not started.alive())
    assert "Traceback" not in said


def test_so_does_ctrl_c(started: Run) -> None:
    os.killpg(started.process.pid, signal.SIGINT)
    _, said = started.process.communicate(timeout=LIMIT_S)
    assert started.process.returncode == 130
    assert started.left() == []
    started.until(lambda: not started.alive())
    assert "Traceback" not in said


def test_workers_do_not_outlive_a_parent_that_was_killed(started: Run) -> None:
    started.process.kill()
    started.process.wait(timeout=LIMIT_S)
    started.until(lambda: not started.alive())


def test_the_first_signal_unwinds_and_the_next_are_ignored() -> None:
    before = signal.getsignal(signal.SIGTERM)
    cleaned = []

    def stopped(first: int) -> None:
        with graceful_shutdown():
            try:
                os.kill(os.getpid(), first)
                time.sleep(5.0)
            finally:
                os.kill(os.getpid(), signal.SIGTERM)
                os.kill(os.getpid(), signal.SIGINT)
                cleaned.append(first)

    with pytest.raises(Terminated):
        stopped(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        stopped(signal.SIGINT)
    assert cleaned == [signal.SIGTERM, signal.SIGINT]
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize(
    ("number", "code", "word"),
    [(signal.SIGTERM, 143, "adk: terminated"), (signal.SIGINT, 130, "adk: interrupted")],
)
def test_the_verb_says_that_it_was_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    number: int, code: int, word: str,
) -> None:  # fmt: skip
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))

    def stopped(*given: object) -> None:
        assert list((tmp_path / "tmp").glob("adk_paper_*"))
        os.kill(os.getpid(), number)
        time.sleep(5.0)

    monkeypatch.setattr(runs, "run_paper", stopped)
    out = tmp_path / "out"
    assert main(["bench", "paper", "--no-peers", "--out", str(out)]) == code
    assert word in capsys.readouterr().err
    assert list((tmp_path / "tmp").iterdir()) == list(out.iterdir()) == []


def test_a_report_replaces_the_one_before_whole(tmp_path: Path) -> None:
    def write(folder: Path, text: str) -> None:
        (folder / "tables").mkdir(exist_ok=True)
        (folder / "tables" / f"{text}.md").write_text(text)
        (folder / "report.html").write_text(text)

    out = tmp_path / "out"
    out.mkdir()
    write(out, "old")
    (out / "mine.txt").write_text("stays")

    def stopped() -> None:
        with staged_folder(out, ("report.html",)) as staged:
            write(staged, "half")
            raise Terminated

    with pytest.raises(Terminated):
        stopped()
    assert sorted(path.name for path in out.rglob("*.*")) == ["mine.txt", "old.md", "report.html"]
    assert (out / "report.html").read_text() == "old"
    with staged_folder(out, ("report.html",)) as staged:
        write(staged, "new")
        assert (out / "report.html").read_text() == "old"
    assert sorted(path.name for path in out.rglob("*.*")) == ["mine.txt", "new.md", "report.html"]
    assert (out / "report.html").read_text() == "new"
