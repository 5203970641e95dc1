# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Node and watch run, and end on a signal, while nobody reads their output."""

from __future__ import annotations

import contextlib
import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.node import write_model
from helpers.watch import surrogate

from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.ros.session import Session

FROM_PIPE = """
import os, sys
from adk_ros.ros.unread_output import STDERR, discard_unread_output
discard_unread_output(STDERR)
for _ in range(100_000):
    print("line", file=sys.stderr)
os.write(1, b"done")
"""


@pytest.fixture
def full_pipe() -> Iterator[int]:
    """The end to write to of a full pipe that nobody reads."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(4096))
    os.set_blocking(writer, True)
    yield writer
    os.close(writer)
    os.close(reader)


def start_node(folder: Path, stderr: int) -> subprocess.Popen[bytes]:
    model = write_model(folder / "model")
    command = ["adk_ros.ros.node", "--ros-args", "-p", f"model:={model}"]
    return subprocess.Popen([sys.executable, "-m", *command], stderr=stderr)


def start_watch(folder: Path, stderr: int) -> subprocess.Popen[bytes]:
    model = folder / "simulation.yaml"
    model.write_text(simulation_yaml(surrogate()))
    command = ["adk_ros.cli.main", "watch", "--model", str(model)]
    return subprocess.Popen([sys.executable, "-m", *command], stderr=stderr)


@pytest.mark.parametrize(
    ("start", "number"), [(start_node, signal.SIGTERM), (start_watch, signal.SIGINT)]
)
def test_a_full_pipe_stops_nothing(
    tmp_path: Path,
    full_pipe: int,
    start: Callable[[Path, int], subprocess.Popen[bytes]],
    number: signal.Signals,
) -> None:
    process = start(tmp_path, full_pipe)
    try:
        with Session("listener") as session:
            received: list[DiagnosticArray] = []
            session.node.create_subscription(DiagnosticArray, "/diagnostics", received.append, 10)
            until_s = time.monotonic() + 90.0
            # The second is published when the start is over.
            while len(received) < 2 and time.monotonic() < until_s:
                session.spin(0.1)
        assert len(received) >= 2
        begin_s = time.monotonic()
        process.send_signal(number)
        assert process.wait(10.0) in (0, 130)
        assert time.monotonic() - begin_s < 2.0
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    assert not fcntl.fcntl(full_pipe, fcntl.F_GETFL) & os.O_NONBLOCK


def test_lines_beyond_the_pipe_are_discarded() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", FROM_PIPE], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.wait(30.0) == 0
    out, errors = process.communicate()
    assert out == b"done"
    assert errors.startswith(b"line\nline\n")
    assert len(errors) < 5 * 100_000


def test_a_file_gets_all_lines(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text("before\n")
    with log.open("ab") as file:
        subprocess.run([sys.executable, "-c", FROM_PIPE], check=True, stderr=file, timeout=30.0)
    assert log.read_text() == "before\n" + 100_000 * "line\n"
