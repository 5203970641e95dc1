# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Signals end a verb in one line, and leave no process, no temporary folder, no partial report."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, suppress
from pathlib import Path

import pytest
from helpers.train import lines

from adk_ros.bench.paper import paper_bench as runs
from adk_ros.cli.console import progress
from adk_ros.cli.main import main
from adk_ros.files.output_folder import staged_folder
from adk_ros.shutdown import (
    TERMINATED,
    Terminated,
    graceful_shutdown,
    interruptible,
    raise_received,
)

LIMIT_S = 120.0

SCRIPT = """
import sys, tempfile
from pathlib import Path
from adk_ros.bench.paper.cases import Durations
from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown
from adk_ros.bench.paper.training_jobs import BenchPlan, TrainingJob
from adk_ros.bench.paper.paper_bench import _Pool

if __name__ == "__main__":
    plan = BenchPlan(tests=("nominal",), durations=Durations(train=20.0, test=8.0))
    try:
        with (
            graceful_shutdown(), tempfile.TemporaryDirectory(prefix="adk_paper_") as folder,
            _Pool(plan, Path(folder), 2, 2) as pool,
        ):
            pool.run([TrainingJob("simulate", about="nominal")], "simulating", None, None)
            jobs = [TrainingJob("peers"), TrainingJob("peers", "noisy")]
            pool.run(jobs, "predicting", None, None)
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
    """A run whose baseline workers never answer, in a separate session and temporary folder."""

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
        # A separate session: Ctrl-C goes to the whole process group.
        self.process = subprocess.Popen(
            [sys.executable, str(script)],
            env=environment,
            start_new_session=True,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.until(lambda: len(self.peers()) == 2)

    def peers(self) -> list[int]:
        """Return the process ids of the baseline workers so far."""
        return [int(line) for line in lines(self._pids.read_text())] if self._pids.exists() else []

    def alive(self) -> list[str]:
        """Return the names of the processes in the session, zombies excluded."""
        found = []
        for file in Path("/proc").glob("[0-9]*/stat"):
            try:
                name, _, fields = file.read_text().rpartition(")")
            except OSError:
                continue
            state, _, _, session = fields.split()[:4]
            if int(session) == self.process.pid and state != "Z":
                found.append(name)
        return found

    def until(self, condition: object) -> None:
        """Wait until a condition holds."""
        assert callable(condition)
        end = time.monotonic() + LIMIT_S
        while not condition():
            assert time.monotonic() < end, self.alive()
            time.sleep(0.05)

    def remaining_folders(self) -> list[str]:
        """Return the temporary folders of the run that still exist."""
        return [path.name for path in self.temporary.iterdir() if path.name.startswith("adk_")]


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Run]:
    """A run that waits for its baseline workers."""
    run = Run(tmp_path)
    yield run
    if run.process.poll() is None:
        os.killpg(run.process.pid, signal.SIGKILL)
    run.process.communicate()


@pytest.mark.slow
def test_sigterm_ends_all_workers_and_removes_the_folders(started: Run) -> None:
    assert len(started.remaining_folders()) == 1
    started.process.terminate()
    _, errors = started.process.communicate(timeout=LIMIT_S)
    assert started.process.returncode == TERMINATED == 143
    assert started.remaining_folders() == []
    started.until(lambda: not started.alive())
    assert "Traceback" not in errors


@pytest.mark.slow
def test_ctrl_c_ends_all_workers_and_removes_the_folders(started: Run) -> None:
    os.killpg(started.process.pid, signal.SIGINT)
    _, errors = started.process.communicate(timeout=LIMIT_S)
    assert started.process.returncode == 130
    assert started.remaining_folders() == []
    started.until(lambda: not started.alive())
    assert "Traceback" not in errors


@pytest.mark.slow
def test_workers_end_with_a_killed_parent(started: Run) -> None:
    started.process.kill()
    started.process.wait(timeout=LIMIT_S)
    started.until(lambda: not started.alive())


def test_first_signal_unwinds_and_later_ones_are_ignored() -> None:
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


@pytest.fixture
def heeded() -> Iterator[None]:
    """Heed Ctrl-C, which is ignored where the tests run in a background job of a shell."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def ctrl_c() -> None:
    """Press Ctrl-C, and wait for the exception."""
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(5.0)


@pytest.mark.usefixtures("heeded")
@pytest.mark.parametrize("context", [interruptible, graceful_shutdown])
def test_a_swallowed_interruption_is_raised_by_the_next_report(
    context: Callable[[], AbstractContextManager[None]],
) -> None:
    def swallowed() -> None:
        with context(), progress("work") as report:
            report(1, 3)
            with suppress(BaseException):
                ctrl_c()
            report(2, 3)

    with pytest.raises(KeyboardInterrupt):
        swallowed()
    with interruptible(), progress("work") as report:
        report(3, 3)


@pytest.mark.usefixtures("heeded")
@pytest.mark.parametrize("context", [interruptible, graceful_shutdown])
def test_an_interruption_that_became_an_error_is_raised(
    context: Callable[[], AbstractContextManager[None]],
) -> None:
    def converted() -> None:
        try:
            ctrl_c()
        except KeyboardInterrupt:
            raise RuntimeError("an attribute cannot be set") from None

    with pytest.raises(KeyboardInterrupt), context():
        converted()
    with pytest.raises(RuntimeError), context():
        raise RuntimeError("no signal")


@pytest.mark.usefixtures("heeded")
def test_an_interruption_within_a_finaliser_prints_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Finalised:
        def __del__(self) -> None:
            ctrl_c()

    def finalise() -> None:
        finalised = Finalised()
        del finalised
        raise_received()

    with pytest.raises(KeyboardInterrupt), interruptible():
        finalise()
    assert capsys.readouterr().err == ""


def test_an_ignored_interruption_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruptible():
            os.kill(os.getpid(), signal.SIGINT)
            raise_received()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    ("number", "code", "word"),
    [(signal.SIGTERM, 143, "adk: terminated"), (signal.SIGINT, 130, "adk: interrupted")],
)
def test_interrupted_verb_reports_the_signal(
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


def test_report_replaces_an_earlier_one_completely(tmp_path: Path) -> None:
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
