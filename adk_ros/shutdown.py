# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Being stopped half-way: SIGTERM and Ctrl-C unwind the run, so that nothing of it is left behind.

The parent ends its workers, they end what they have started, and folders go with who made them.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import parent_process
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from types import FrameType

GRACE_S = 10.0
"""How long a worker may take to end what it has started."""
TERMINATED = 128 + signal.SIGTERM


class Terminated(BaseException):
    """SIGTERM came; no mistake that anybody should handle as one."""


@contextmanager
def graceful_shutdown() -> Iterator[None]:
    """
    Turn the first SIGTERM or SIGINT into `Terminated` or KeyboardInterrupt, and ignore the rest.

    What is cleaned up on the way out must not be stopped by an impatient second one. What was in
    force comes back after. Does nothing in a thread, where signals cannot be heard.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM)

    def stop(number: int, frame: FrameType | None) -> None:
        for other in numbers:
            signal.signal(other, signal.SIG_IGN)
        raise KeyboardInterrupt if number == signal.SIGINT else Terminated

    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_all(processes: Iterable[BaseProcess]) -> None:
    """Ask processes to end, and make those that do not within `GRACE_S`."""
    todo = list(processes)
    for process in todo:
        process.terminate()
    deadline = time.monotonic() + GRACE_S
    for process in todo:
        process.join(max(0.0, deadline - time.monotonic()))
        if process.is_alive():
            process.kill()
            process.join()


def begin_worker() -> None:
    """
    In a worker: SIGTERM unwinds what it is at, Ctrl-C is the parent's to answer.

    A parent that was killed says nothing, so its end is watched for.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _on_sigterm)
    threading.Thread(target=_follow, daemon=True).start()


def _on_sigterm(number: int, frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_IGN)
    raise SystemExit(TERMINATED)


def _follow() -> None:
    parent = parent_process()
    if parent is None:
        return
    wait([parent.sentinel])
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_S)
    os._exit(TERMINATED)
