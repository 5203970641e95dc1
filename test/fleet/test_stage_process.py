# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The process in which a stage runs: limits, deaths, and what becomes of them."""

from __future__ import annotations

import errno
import os
import pickle
import signal
import tempfile
import threading
import time
from pathlib import Path

import psutil
import pytest
from helpers.fleet import copy_and_wait, length_of_bytes, started_child, text_stage

from adk_ros.errors import UsageError
from adk_ros.fleet.stage_process import Failure, StageProcess, call
from adk_ros.fleet.store import StoreUnreachable


@pytest.fixture(scope="module")
def process():
    started = StageProcess(memory_mib=300.0)
    yield started
    started.close()


def test_values_and_errors(process, tmp_path) -> None:
    stage = text_stage(tmp_path / "log")
    (tmp_path / "a").write_text("ok 2")
    (tmp_path / "b").write_text("damaged")
    (tmp_path / "c").write_text("raise")
    reply = process.run(stage.run, [tmp_path / "a", "a"])
    assert reply.failure is None
    assert [row["value"] for row in reply.value] == [2.0, 4.0]
    pid = process.pid
    damaged = process.run(stage.run, [tmp_path / "b", "b"])
    assert (damaged.failure, damaged.reason) == (Failure.UNUSABLE, "b is damaged")
    fault = process.run(stage.run, [tmp_path / "c", "c"])
    assert fault.failure is Failure.ERROR
    assert fault.reason.startswith("ZeroDivisionError: a fault of the stage (fleet.py:")
    assert process.pid == pid, "errors do not end the process"


def test_memory_is_not_given_back_after_each_array(monkeypatch) -> None:
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    started = StageProcess()
    try:
        assert started.run(os.getenv, ["MALLOC_TRIM_THRESHOLD_"]).value is None
        assert started.run(os.getenv, ["OPENBLAS_NUM_THREADS"]).value == "1"
    finally:
        started.close()


def test_time_and_death(process) -> None:
    reply = process.run(time.sleep, [60.0], timeout_s=0.2)
    assert (reply.failure, reply.reason) == (
        Failure.TIMEOUT, "takes longer than 0.2 s (--timeout)"
    )  # fmt: skip
    killed = process.run(os._exit, [3])
    assert (killed.failure, killed.reason) == (
        Failure.KILLED, "its process was ended by exit code 3"
    )  # fmt: skip
    process.run(os.getpid, [])
    threading.Timer(0.2, lambda: os.kill(process.pid, signal.SIGKILL)).start()
    assert process.run(time.sleep, [60.0]).reason == "its process was ended by signal SIGKILL"
    assert process.run(abs, [-1]).value == 1


def test_memory(process, tmp_path) -> None:
    stage = text_stage(tmp_path / "log")
    (tmp_path / "a").write_text("grow")
    reply = process.run(stage.run, [tmp_path / "a", "a"])
    assert reply.failure is Failure.MEMORY
    assert "needs more than 300 MiB" in reply.reason
    assert reply.memory_mib > 300.0


def test_memory_is_that_of_a_task(process) -> None:
    before = process.run(abs, [-1])
    large = process.run(length_of_bytes, [100 * 2**20])
    after = process.run(abs, [-1])
    assert large.memory_mib > before.memory_mib + 90.0
    assert after.memory_mib < large.memory_mib - 80.0


def test_a_process_that_keeps_much_memory_is_replaced() -> None:
    process = StageProcess(memory_mib=20.0)
    reply = process.run(os.getpid, [])
    assert reply.failure in {None, Failure.MEMORY}
    assert process.pid is None


def test_the_process_ends_with_its_parent() -> None:
    parent = StageProcess()
    child = parent.run(started_child, []).value
    assert psutil.pid_exists(child)
    assert parent.pid is not None
    os.kill(parent.pid, signal.SIGKILL)
    deadline = time.monotonic() + 5.0
    while psutil.pid_exists(child) and time.monotonic() < deadline:
        time.sleep(0.05)
    ended = not psutil.pid_exists(child) or psutil.Process(child).status() == "zombie"
    parent.close()
    assert ended


def test_temporary_files_go_with_the_process(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    process = StageProcess()
    assert Path(process.run(copy_and_wait, [0.0]).value).is_relative_to(tmp_path)
    assert process.run(copy_and_wait, [60.0], timeout_s=0.5).failure is Failure.TIMEOUT
    assert list(tmp_path.iterdir()) == []


def test_temporary_files_go_with_the_parent(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    parent = StageProcess()
    parent.run(started_child, [])
    assert parent.pid is not None
    (scratch,) = tmp_path.iterdir()
    assert len(list(scratch.iterdir())) == 1
    os.kill(parent.pid, signal.SIGKILL)
    deadline = time.monotonic() + 20.0
    while list(scratch.iterdir()) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert list(scratch.iterdir()) == []
    parent.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "failure"),
    [
        (UsageError("x"), Failure.UNUSABLE),
        (StoreUnreachable("x"), Failure.UNREACHABLE),
        (MemoryError(), Failure.MEMORY),
        (OSError(28, "No space left on device"), Failure.DISK_FULL),
        (OSError(5, "Input/output error"), Failure.ERROR),
        (RuntimeError("x"), Failure.ERROR),
    ],
)
def test_kinds_of_failure(error, failure) -> None:
    def fails():
        raise error

    assert call(fails, []).failure is failure


def test_a_function_that_the_process_does_not_have(process) -> None:
    class Unknown:
        pass

    with pytest.raises((AttributeError, TypeError, pickle.PicklingError)):
        process.run(Unknown, [])
    assert process.run(abs, [-2]).value == 2


def refused_by_a_full_disk() -> None:
    try:
        raise OSError(errno.ENOSPC, "No space left on device")
    except OSError as error:
        raise UsageError(f"page cannot be written: {error.strerror}") from None


def test_a_full_disk_behind_a_refusal_is_no_fault_of_the_recording() -> None:
    assert call(refused_by_a_full_disk, ()).failure is Failure.DISK_FULL
