# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A process that runs one function at a time, with a limit on time and memory.

A thread of a worker cannot be stopped, a process can. It ends with its parent, however that ends.
Functions and values are pickled between the two, which are both ours.
"""

from __future__ import annotations

import errno
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Any

import psutil

from adk_ros.errors import AdkError, first_line, one_line
from adk_ros.fleet.recordings import RecordingChanged
from adk_ros.fleet.store import StoreUnreachable

ATTEMPTS = 3
"""Times that a task is started whose process or worker is killed; then it has failed."""
_MEMORY_CHECK_S = 0.1
"""Time between two looks at the memory of the process."""
_RETIRE_SHARE = 0.5
"""Share of the memory limit that an idle process may hold before a new one replaces it."""


class Failure(str, Enum):
    """Why a recording has no result."""

    UNUSABLE = "unusable"
    ERROR = "error"
    TIMEOUT = "timeout"
    MEMORY = "memory"
    KILLED = "killed"
    UNREACHABLE = "unreachable"
    DISK_FULL = "disk full"
    CHANGED = "changed"
    OTHER_CODE = "other code"
    NOT_SHARED = "not shared"


ENDS_RUN = frozenset(
    {Failure.UNREACHABLE, Failure.DISK_FULL, Failure.OTHER_CODE, Failure.NOT_SHARED}
)
"""Failures that say nothing about a recording and would hit all others: the run stops."""


class NotShared(AdkError):
    """A worker does not see a file of the driver; the recording itself may be in order."""


@dataclass(frozen=True)
class Reply:
    """
    The result of a function, or why there is none.

    `seconds` that it took; `memory_mib`: peak memory of its process meanwhile, MiB.
    """

    value: Any = None
    failure: Failure | None = None
    reason: str = ""
    seconds: float = 0.0
    memory_mib: float = 0.0


class StageProcess:
    """
    A child process that runs functions, one at a time; a new one is started when it has ended.

    It has a temporary folder, which is removed however it ends: a copied recording is large.

    :param memory_mib: resident memory at which it is killed, MiB; None: no limit.
    """

    def __init__(self, memory_mib: float | None = None) -> None:
        self._memory_mib = memory_mib
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Any = None
        self._scratch = ""

    def run(
        self,
        function: Callable[..., Any],
        arguments: Sequence[Any],
        timeout_s: float | None = None,
    ) -> Reply:
        """Return what the function returns; whatever happens to the process is a `Reply`."""
        started = time.monotonic()
        self._ensure_running()
        assert self._process is not None
        try:
            self._connection.send((function, tuple(arguments)))
            while not self._connection.poll(_MEMORY_CHECK_S):
                if timeout_s is not None and time.monotonic() - started > timeout_s:
                    self.close()
                    return Reply(
                        failure=Failure.TIMEOUT,
                        reason=f"takes longer than {timeout_s:g} s (--timeout)",
                        seconds=timeout_s,
                    )
                used = self._used_mib()
                if self._memory_mib is not None and used > self._memory_mib:
                    self.close()
                    return Reply(
                        failure=Failure.MEMORY,
                        reason=f"needs more than {self._memory_mib:.0f} MiB of memory (--memory)",
                        seconds=time.monotonic() - started,
                        memory_mib=used,
                    )
            reply: Reply = self._connection.recv()
        except (EOFError, ConnectionError):
            code = self._process.wait()
            self.close()
            how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            return Reply(
                failure=Failure.KILLED,
                reason=f"its process was ended by {how}",
                seconds=time.monotonic() - started,
            )
        if self._memory_mib is not None and self._used_mib() > _RETIRE_SHARE * self._memory_mib:
            self.close()
        return reply

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            if self._process.stdin is not None:
                self._process.stdin.close()
            self._connection.close()
        _remove(self._scratch)
        self._process = self._connection = None
        self._scratch = ""

    @property
    def pid(self) -> int | None:
        """Number of the process; None if none runs."""
        return None if self._process is None else self._process.pid

    def _used_mib(self) -> float:
        assert self._process is not None
        try:
            return float(psutil.Process(self._process.pid).memory_info().rss / 2**20)
        except psutil.Error:
            return 0.0

    def _ensure_running(self) -> None:
        if self._process is not None and self._process.poll() is None:
            return
        self.close()
        ours, theirs = Pipe()
        # On a full disk the function finds none either, and says so.
        with suppress(OSError):
            self._scratch = tempfile.mkdtemp(prefix="adk_stage_")
        code = f"from {__name__} import serve; serve({theirs.fileno()}, {self._scratch!r})"
        paths = [path or str(Path.cwd()) for path in sys.path]
        temporary = {"TMPDIR": self._scratch} if self._scratch else {}
        # Its standard input ends when this process does.
        self._process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            env=_environment() | temporary | {"PYTHONPATH": os.pathsep.join(paths)},
        )
        theirs.close()
        self._connection = ours


def _environment() -> dict[str, str]:
    """
    Return the variables of this process without the threshold at which Dask lets malloc trim.

    With it, malloc maps and the kernel clears each array above 128 kB anew, which takes a third of
    the time of a linearisation. What a process holds is bounded by its limit.
    """
    return {name: value for name, value in os.environ.items() if name != "MALLOC_TRIM_THRESHOLD_"}


def serve(descriptor: int, scratch: str) -> None:
    """
    Run the functions that arrive on a connection until it ends: the child's main function.

    :param scratch: temporary folder, "" for none; removed when the parent has ended.
    """
    # Ctrl-C reaches all processes of a terminal: the parent decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(scratch,), daemon=True).start()
    connection: Any = Connection(descriptor)
    while True:
        try:
            function, arguments = connection.recv()
        except EOFError:
            _remove(scratch)
            return
        except Exception as error:  # a function that this process does not have
            connection.send(worker_fault(error))
            continue
        connection.send(call(function, arguments))


def worker_fault(error: Exception) -> Reply:
    """Return why a worker cannot run any task: the run stops."""
    text = one_line(f"{type(error).__name__}: {first_line(error)}")
    if isinstance(error, OSError | MemoryError):
        reason = f"a worker has no memory, processes or files left ({text}): use fewer workers"
    else:
        reason = (
            f"a worker cannot run the work ({text}): install the same version of adk_ros and of "
            "its libraries on all machines"
        )
    return Reply(failure=Failure.OTHER_CODE, reason=reason)


def call(function: Callable[..., Any], arguments: Sequence[Any]) -> Reply:
    """Return what a function returns, or what it raises, as a `Reply`."""
    started = time.monotonic()
    value, failure, reason = None, None, ""
    _forget_peak()
    try:
        value = function(*arguments)
    except StoreUnreachable as error:
        failure, reason = Failure.UNREACHABLE, str(error)
    except NotShared as error:
        failure, reason = Failure.NOT_SHARED, str(error)
    except RecordingChanged as error:
        failure, reason = Failure.CHANGED, str(error)
    except AdkError as error:
        # `from None` hides the cause from a reader, not from the program.
        full = _is_full(error) or _is_full(error.__context__)
        failure, reason = Failure.DISK_FULL if full else Failure.UNUSABLE, str(error)
    except MemoryError:
        failure, reason = Failure.MEMORY, "out of memory"
    except OSError as error:
        failure = Failure.DISK_FULL if _is_full(error) else Failure.ERROR
        reason = _described(error)
    except Exception as error:
        failure, reason = Failure.ERROR, _described(error)
    return Reply(value, failure, reason, time.monotonic() - started, _peak_mib())


def _is_full(error: BaseException | None) -> bool:
    """Whether an error says that a disk is full."""
    return isinstance(error, OSError) and error.errno in {errno.ENOSPC, errno.EDQUOT}


def _forget_peak() -> None:
    """Let the peak memory of this process begin anew, where the kernel can do that."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak_mib() -> float:
    """Return the peak memory since `_forget_peak`, or of the process, MiB."""
    with suppress(OSError, StopIteration, ValueError):
        lines = Path("/proc/self/status").read_text().splitlines()
        return float(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _described(error: Exception) -> str:
    """Return type, text and place of an unexpected error."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return one_line(f"{type(error).__name__}: {first_line(error)}{place}")


def _end_with_parent(scratch: str) -> None:
    sys.stdin.buffer.read()
    _remove(scratch)
    os._exit(1)


def _remove(scratch: str) -> None:
    if scratch:
        shutil.rmtree(scratch, ignore_errors=True)
