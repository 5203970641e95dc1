# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command in processes of its own: what each said and used, and an end to all of them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from typing import NamedTuple

_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "NUMBA", "MKL")}


class Usage(NamedTuple):
    """Exit status, last line on stderr, seconds of wall and of CPU, largest memory in MiB."""

    status: int
    output: str
    seconds: float
    cpu_s: float
    memory_mib: float


class SubprocessEnded(Exception):
    """A process was not begun, or was ended, since all are to end."""


class Subprocesses:
    """Processes that threads wait for, and that another thread may end."""

    def __init__(self) -> None:
        self._running: set[int] = set()
        self._lock = threading.Lock()
        self._over = False

    def adk(self, arguments: Sequence[str]) -> Usage:
        """
        Run the command and wait for it.

        :raises Ended: `end` was called before it was through.
        """
        command = [sys.executable, "-m", "adk_ros.cli.main", *arguments]
        with self._lock:
            if self._over:
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
            said = process.stderr.read()
        # Known to have ended, and its number still its own until it is waited for.
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        with self._lock:
            self._running.discard(process.pid)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if self._over:
            raise SubprocessEnded
        lines = said.strip().splitlines()
        return Usage(
            process.returncode,
            lines[-1] if lines else "",
            time.monotonic() - started,
            usage.ru_utime + usage.ru_stime,
            usage.ru_maxrss / 1024.0,
        )

    def end(self) -> None:
        """End all that run, at once; what they leave half done is in folders of the caller's."""
        with self._lock:
            self._over = True
            for pid in self._running:
                os.kill(pid, signal.SIGKILL)
