# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One run at a time writes to an output folder."""

from __future__ import annotations

import fcntl
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from adk_ros.errors import UsageError

LOCK_FILE = ".lock"

_held: set[tuple[int, int, str]] = set()
"""Process, thread and folder of the locks that are held here. A forked process holds none."""


@contextmanager
def run_lock(out: Path) -> Iterator[None]:
    """
    Hold the lock of an output folder, which is created if need be.

    A verb holds it from its first to its last stage; stages that take it again in the same thread
    do nothing. The kernel releases it when the process ends, however it ends.

    :raises UsageError: another run holds it, or the folder cannot be written.
    """
    held = (os.getpid(), threading.get_ident(), os.path.realpath(out))
    if held in _held:
        yield
        return
    try:
        out.mkdir(parents=True, exist_ok=True)
        file = (out / LOCK_FILE).open("a+")
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror or error}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.seek(0)
            holder = file.read().strip() or "another process"
            raise UsageError(
                f"{out} is in use by {holder}: wait for it, or name another folder for --out"
            ) from None
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}")
        file.flush()
        _held.add(held)
        try:
            yield
        finally:
            _held.remove(held)
