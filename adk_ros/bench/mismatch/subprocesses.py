# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Run the `adk` command in subprocesses: message, resource usage, and termination of all."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "NUMBA", "MKL")}


class ProcessResult(NamedTuple):
    """Exit status, last line on stderr, wall and CPU time (s), largest resident set (MiB)."""

    status: int
    output: str
    seconds: float
    cpu_s: float
    memory_mib: float


class SubprocessEnded(Exception):
    """A process was terminated, or not started, because `end` was called."""


class Subprocesses:
    """Processes that threads wait for and that another thread may end."""

    def __init__(self) -> None:
        self._running: set[int] = set()
        self._lock = threading.Lock()
        self._ended = False

    def adk(
        self, arguments: Sequence[str], factors: Mapping[str, float] | None = None
    ) -> ProcessResult:
        """
        Run the command and wait for it; `factors`: a criterion to multiply, and by how much.

        :raises SubprocessEnded: `end` was called before it finished.
        """
        module = ["adk_ros.cli.main"]
        if factors:
            ((name, factor),) = factors.items()
            module = ["adk_ros.cli.varied_command", f"{name}={factor:g}"]
        command = [sys.executable, "-m", *module, *arguments]
        with self._lock:
            if self._ended:
                raise SubprocessEnded
            started = time.monotonic()
            process = subprocess.Popen(
                command,
                env=os.environ | _ONE_THREAD,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
            self._running.add(process.pid)
        assert process.stderr is not None
        with process.stderr:
            messages = process.stderr.read()
        # Wait without reaping: the process id stays reserved until it is removed from the set.
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        with self._lock:
            self._running.discard(process.pid)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if self._ended:
            raise SubprocessEnded
        lines = messages.strip().splitlines()
        return ProcessResult(
            process.returncode,
            lines[-1] if lines else "",
            time.monotonic() - started,
            usage.ru_utime + usage.ru_stime,
            usage.ru_maxrss / 1024.0,
        )

    def end(self) -> None:
        """Kill all running processes; their partial output is in folders of the caller."""
        with self._lock:
            self._ended = True
            for pid in self._running:
                os.kill(pid, signal.SIGKILL)
