# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics while the node loads its model and compiles kernels, before it spins."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_PERIOD_S = 1.0
"""s between reports: the default of `diagnostics_period_s`."""


@contextmanager
def reporting_start(publish: Callable[[str], None]) -> Iterator[None]:
    """
    Call `publish` with a text at once, and every second from another thread, until the end.

    The compiler releases the interpreter while it works, so that the thread runs.
    """
    ended = threading.Event()
    begin_s = time.monotonic()

    def report() -> None:
        while True:
            elapsed_s = time.monotonic() - begin_s
            publish(f"starting for {elapsed_s:.0f} s: loading the model, compiling kernels")
            if ended.wait(_PERIOD_S):
                return

    thread = threading.Thread(target=report, name="starting", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
