# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compile the kernels of commands and node, so that none is compiled at its first use."""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numba.core import event  # type: ignore[import-untyped, unused-ignore]

from adk_ros.api.kernel_calls import AFTER_GROUPS, GROUPS, Call
from adk_ros.api.progress import Progress, in_stage
from adk_ros.errors import UsageError
from adk_ros.shutdown import begin_worker, worker_pool

_POLL_S = 0.5
_FUNCTIONS = 158
"""Functions that an empty cache lacks: the total of the progress."""


@dataclass(frozen=True)
class Compilation:
    """Number of functions compiled, and the duration in s."""

    compiled: int
    seconds: float


def compile_kernels(progress: Progress | None = None) -> Compilation:
    """
    Compile what the cache on disk lacks, in two processes.

    :raises UsageError: no folder for compiled code is writable.
    :raises DataError: a process was killed.
    """
    started = time.monotonic()
    _check_cache_folder()
    report = in_stage(progress, "compiling")
    compiled = multiprocessing.get_context("spawn").Value("i", 0)
    with worker_pool(len(GROUPS), _begin, (compiled,)) as executor:
        for groups in (GROUPS, (AFTER_GROUPS,)):
            futures = {executor.submit(_run, group) for group in groups}
            while futures:
                finished, futures = wait(futures, _POLL_S, FIRST_COMPLETED)
                for future in finished:
                    future.result()
                report(min(compiled.value, _FUNCTIONS), _FUNCTIONS)
    report(_FUNCTIONS, _FUNCTIONS)
    return Compilation(compiled.value, time.monotonic() - started)


def _check_cache_folder() -> None:
    from adk_ros.numerics import runge_kutta

    kernel: Any = runge_kutta.clip
    if kernel.stats.cache_path is None:
        raise UsageError(
            f"compiled code cannot be stored: neither {Path(runge_kutta.__file__).parent} nor the "
            "user's cache folder is writable; set NUMBA_CACHE_DIR to a folder that is"
        )


def _begin(compiled: Any) -> None:
    """Set up a worker process that counts its compilations in `compiled`."""
    # An exception would be lost in a callback of the compiler. The cache is never half-written.
    begin_worker(unwinds=False)
    event.register("numba:compile", _Counter(compiled))  # type: ignore[no-untyped-call]


class _Counter(event.Listener):  # type: ignore[misc, unused-ignore]
    """Counts the functions of this package that numba compiles."""

    def __init__(self, compiled: Any) -> None:
        self._compiled = compiled

    def on_start(self, event: Any) -> None:
        """Wait for the end."""

    def on_end(self, event: Any) -> None:
        """Count a function of this package; numba also compiles its own."""
        if event.data["dispatcher"].py_func.__module__.startswith("adk_ros."):
            with self._compiled.get_lock():
                self._compiled.value += 1


def _run(group: tuple[Call, ...]) -> None:
    """Run a group in a worker."""
    for call in group:
        call()
