# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Output that nobody reads must not stop a node.

A write to a full pipe, or to a terminal that is held, waits. The loggers of ROS write in C with
Python's lock held: no thread of Python then runs, also not the one that waits for signals.
"""

from __future__ import annotations

import io
import os
import stat
import sys

STDOUT, STDERR = 1, 2
"""File descriptors."""
_NAMES = {STDOUT: "stdout", STDERR: "stderr"}


def discard_unread_output(descriptor: int) -> None:
    """
    Have writes to STDOUT or STDERR of this process discarded instead of waiting.

    Only for pipes and terminals; others do not wait. Other processes that share the pipe are not
    affected, since it is opened anew: the flag belongs to the open file, which they share.
    """
    try:
        mode = os.fstat(descriptor).st_mode
        if not (stat.S_ISFIFO(mode) or os.isatty(descriptor)):
            return
        flags = os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY
        again = os.open(f"/proc/self/fd/{descriptor}", flags)
    except OSError:
        # Without a reader, or without the right to open it: left as it is.
        return
    os.dup2(again, descriptor)
    os.close(again)
    name = _NAMES[descriptor]
    before = getattr(sys, name)
    if before.fileno() != descriptor:
        return
    # A buffer would keep what could not be written, and fail when Python ends.
    raw = io.FileIO(descriptor, "w", closefd=False)
    encoding = before.encoding or "utf-8"
    setattr(sys, name, io.TextIOWrapper(raw, encoding, "backslashreplace", write_through=True))
