# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Release timed items at absolute times, so that delays do not accumulate.

The items come from a generator that may be slow at times (decompressing a chunk of a bag), so a
thread reads them ahead into a bounded queue.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Generic, Protocol, TypeVar

_QUEUE_SIZE = 20_000
"""Items read ahead: about 20 s of a bag with 1000 messages per second."""
_MAX_SLEEP_S = 0.1
"""s after which a waiting loop checks whether it is to stop."""


class Timed(Protocol):
    """An item with a time in nanoseconds since the start of the schedule."""

    @property
    def offset_ns(self) -> int:
        """Nanoseconds since the start, at rate 1."""


Item = TypeVar("Item", bound=Timed)


class ReadAhead(Generic[Item]):
    """
    Context manager that iterates over `items`, which a thread reads ahead.

    `stopped`: ends the iteration also while no item is ready; `items` must end by it as well.
    """

    def __init__(self, items: Iterator[Item], stopped: Callable[[], bool] = lambda: False) -> None:
        self._items = items
        self._stopped = stopped
        self._queue: queue.Queue[Item | Exception | None] = queue.Queue(_QUEUE_SIZE)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, name="read ahead", daemon=True)

    def _read(self) -> None:
        # An exception is passed on and raised in the consumer's thread.
        try:
            for item in self._items:
                if not self._put(item):
                    return
            self._put(None)
        except Exception as error:
            self._put(error)

    def _put(self, item: Item | Exception | None) -> bool:
        while not self._ended.is_set():
            try:
                self._queue.put(item, timeout=_MAX_SLEEP_S)
            except queue.Full:
                continue
            return True
        return False

    def __enter__(self) -> ReadAhead[Item]:
        self._thread.start()
        return self

    def __iter__(self) -> Iterator[Item]:
        while True:
            try:
                item = self._queue.get(timeout=_MAX_SLEEP_S)
            except queue.Empty:
                if self._stopped():
                    return
                continue
            if item is None:
                return
            if isinstance(item, Exception):
                raise item
            yield item

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()


def paced(
    items: Iterator[Item], begin_ns: int, rate: float, stopped: Callable[[], bool]
) -> Iterator[tuple[Item, int]]:
    """
    Yield each item at begin_ns + offset_ns / rate of the monotonic clock, until `stopped`.

    Yields (item, delay in ns). `items` must be sorted by time.
    """
    for item in items:
        due_ns = begin_ns + round(item.offset_ns / rate)
        while (remaining_ns := due_ns - time.monotonic_ns()) > 0 and not stopped():
            time.sleep(min(remaining_ns * 1e-9, _MAX_SLEEP_S))
        if stopped():
            return
        yield item, max(-remaining_ns, 0)
