# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Graceful shutdown of a process and its workers on SIGTERM and Ctrl-C.

Signals unwind the stack, so that temporary folders are removed and each process ends the workers
that it started. The exception of a signal is raised wherever the interpreter is, also within the
imports of libraries, some of which tolerate every failure, and within finalisers, whose exceptions
are only printed. So what a signal asked for is remembered and raised again by `raise_received`.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import parent_process
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from types import FrameType
from typing import Any

from adk_ros.errors import DataError

GRACE_S = 10.0
"""s that a worker may take to end its own subprocesses before it is killed."""
TERMINATED = 128 + signal.SIGTERM
"""Exit code after SIGTERM, by shell convention."""


class Terminated(BaseException):
    """SIGTERM was received. A BaseException, so that error handlers do not catch it."""


_received: list[type[BaseException]] = []
"""The exceptions of the signals that were received within the contexts below, until they end."""


def raise_received() -> None:
    """Raise the exception of a signal that was received again, if other code caught it."""
    if _received and threading.current_thread() is threading.main_thread():
        raise _received[-1]


@contextmanager
def interruptible() -> Iterator[None]:
    """
    Raise KeyboardInterrupt at each SIGINT, and from the block if an interruption became an error.

    Where SIGINT is ignored it still is: shells start background jobs in this way. Has no effect
    outside the main thread.
    """
    ignored = signal.getsignal(signal.SIGINT) in (signal.SIG_IGN, None)
    if ignored or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        _received.append(KeyboardInterrupt)
        raise KeyboardInterrupt

    with _handling(stop, (signal.SIGINT,)):
        yield


@contextmanager
def graceful_shutdown() -> Iterator[None]:
    """
    Turn the first SIGTERM or SIGINT into `Terminated` or KeyboardInterrupt; ignore later ones.

    Later signals are ignored so that they do not interrupt the cleanup. The previous handlers are
    restored on exit. Has no effect outside the main thread, which alone receives signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM)

    def stop(number: int, frame: FrameType | None) -> None:
        for other in numbers:
            signal.signal(other, signal.SIG_IGN)
        _received.append(KeyboardInterrupt if number == signal.SIGINT else Terminated)
        raise _received[-1]

    with _handling(stop, numbers):
        yield


@contextmanager
def _handling(
    stop: Callable[[int, FrameType | None], None], numbers: tuple[signal.Signals, ...]
) -> Iterator[None]:
    """Call `stop` at signals; raise what they asked for if the block ends with another error."""

    def note_unraisable(unraisable: Any) -> None:
        # A signal within a finaliser is no defect: `raise_received` raises its exception again.
        if unraisable.exc_type not in (KeyboardInterrupt, Terminated):
            hook(unraisable)

    hook, outer = sys.unraisablehook, len(_received)
    before = {number: signal.signal(number, stop) for number in numbers}
    sys.unraisablehook = note_unraisable
    try:
        yield
    except Exception:
        # Python and libraries turn an interruption, of an import for example, into other errors.
        if len(_received) > outer:
            raise _received[-1] from None
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        sys.unraisablehook = hook
        del _received[outer:]


def end_all(processes: Iterable[BaseProcess]) -> None:
    """Terminate processes, and kill those that do not end within `GRACE_S`."""
    running = list(processes)
    for process in running:
        process.terminate()
    deadline = time.monotonic() + GRACE_S
    for process in running:
        process.join(max(0.0, deadline - time.monotonic()))
        if process.is_alive():
            process.kill()
            process.join()


@contextmanager
def worker_pool(
    workers: int, initializer: Callable[..., None], initargs: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """
    Yield an executor of spawned processes, which an error or interruption in the block ends.

    :raises DataError: a process was killed.
    """
    before = set(multiprocessing.active_children())
    executor = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=initializer,
        initargs=initargs,
    )
    try:
        yield executor
    except BaseException as error:
        end_all(set(multiprocessing.active_children()) - before)
        if isinstance(error, BrokenProcessPool):
            raise DataError("a process was killed, possibly for lack of memory") from None
        raise
    finally:
        # Wait even for a broken pool, see `bench.paper.paper_bench`.
        executor.shutdown(wait=True, cancel_futures=True)


def begin_worker(unwinds: bool = True) -> None:
    """
    Install the signal handling of a worker: SIGTERM unwinds its stack, Ctrl-C is ignored.

    The parent handles Ctrl-C. A thread ends the worker if the parent is killed. While a worker
    begins there is nothing to unwind, and an exception would be printed as that of its
    initializer: SIGTERM ends it at once; without `unwinds` also later.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if unwinds:
        signal.signal(signal.SIGTERM, _on_sigterm)


def _on_sigterm(number: int, frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_IGN)
    raise SystemExit(TERMINATED)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is None:
        return
    wait([parent.sentinel])
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_S)
    os._exit(TERMINATED)
