# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Run tasks on the workers of a Dask cluster; every task ends in an outcome.

Only a few tasks per worker are with the scheduler at a time, and outcomes are passed on as they
arrive: the memory of the driver does not grow with their number.
"""

from __future__ import annotations

import itertools
import queue
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from adk_ros.files.code_digest import code_digest
from adk_ros.fleet.cluster import Cluster
from adk_ros.fleet.stage_process import ATTEMPTS, Failure, Reply, StageProcess, worker_fault

_QUEUED_PER_WORKER = 16
"""Tasks per worker with the scheduler: enough for tasks of 1 ms at a round trip of 10 ms."""
_LOSSES = 2
"""
Times that a task which Dask has given up is submitted again.

Dask counts the end of a worker against all tasks that it had, also those that it had not started;
the work is in a separate process, so a worker rarely ends because of it.
"""
_WAKE_S = 0.5
"""Longest time without a look at the connection to the scheduler."""


@dataclass(frozen=True)
class Task:
    """
    A call of a function in a process with limits.

    `name` identifies it; `code_version`: hash of the code that the worker must have.
    """

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    timeout_s: float | None = None
    memory_mib: float | None = None
    code_version: str = field(default_factory=code_digest)


def run_tasks(
    cluster: Cluster, tasks: Iterable[Task], on_wake: Callable[[], None] | None = None
) -> Iterator[tuple[Task, Reply]]:
    """
    Yield every task with its outcome, as they end.

    :param on_wake: called at least every half second.
    :raises UsageError: the scheduler cannot be reached any more.
    """
    remaining = iter(tasks)
    ended: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()
    numbers = itertools.count()
    # The scheduler keeps statistics for each group of keys for ever: one group for a run.
    group = f"recording-{uuid.uuid4().hex}"
    running: dict[int, _Running] = {}

    def submit(task: Task, losses: int = 0) -> None:
        number = next(numbers)
        running[number] = _Running(task, losses)
        try:
            future = cluster.client.submit(perform, task, key=(group, number), pure=False)
        except Exception:
            # Whatever a closed client raises, which differs between versions of Dask.
            if cluster.is_connected:
                raise
            return  # All tasks are submitted to the next client.
        running[number] = _Running(task, losses, future)
        future.add_done_callback(lambda future: ended.put((number, future)))

    def submit_again() -> None:
        lost = list(running.values())
        running.clear()
        cluster.reconnect()
        for each in lost:
            submit(each.task, each.losses)

    while True:
        if not cluster.is_connected:
            # Since the last task, as between two stages of a verb.
            submit_again()
        room = max(1, cluster.threads) * _QUEUED_PER_WORKER - len(running)
        for task in itertools.islice(remaining, max(0, room)):
            submit(task)
        if not running:
            return
        if on_wake is not None:
            on_wake()
        cluster.replace_lost_workers()
        try:
            number, future = ended.get(timeout=_WAKE_S)
        except queue.Empty:
            future = None
        if not cluster.is_connected:
            submit_again()
            continue
        if future is None or number not in running:
            continue
        each = running.pop(number)
        reply = _reply(future)
        # Dask computes what is still held again if its worker ends, also when it is stored.
        future.release()
        if reply is None:
            submit(each.task, each.losses)
        elif reply.failure is Failure.KILLED and not reply.seconds and each.losses < _LOSSES:
            submit(each.task, each.losses + 1)
        else:
            yield each.task, reply


class _Running(NamedTuple):
    """
    A task, how often Dask has given it up because workers ended, and its future.

    The future is held, since Dask drops the task of one that nobody holds; None: not submitted.
    """

    task: Task
    losses: int
    future: Any = None


def _reply(future: Any) -> Reply | None:
    """Return the outcome of a task; None if it was lost on the way: it has to run again."""
    if future.status in {"cancelled", "lost"}:
        return None
    is_fault = future.status == "error"
    try:
        reply: Reply = future.result()
    except Exception as error:  # of the connection, or of the task
        if type(error).__name__ == "KilledWorker":
            reason = "worker after worker was killed while it worked on it"
            return Reply(failure=Failure.KILLED, reason=reason)
        if not is_fault:
            return None
        # What a stage raises is a reply: this is a fault of the worker, or of its installation.
        return worker_fault(error)
    return reply


_processes = threading.local()


def perform(task: Task) -> Reply:
    """Run a task in the stage process of this thread: what a worker does."""
    if code_digest() != task.code_version:
        return Reply(
            failure=Failure.OTHER_CODE,
            reason="a worker runs another version of adk_ros: install the same on all machines",
        )
    process = getattr(_processes, "process", None)
    if process is None or _processes.memory_mib != task.memory_mib:
        if process is not None:
            process.close()
        process = StageProcess(task.memory_mib)
        _processes.process, _processes.memory_mib = process, task.memory_mib
    for attempt in range(ATTEMPTS):
        reply: Reply = process.run(task.function, task.arguments, task.timeout_s)
        if reply.failure is not Failure.KILLED:
            return reply
        if attempt + 1 < ATTEMPTS:
            time.sleep(0.1)
    return replace(reply, reason=f"{reply.reason}, {ATTEMPTS} times")
