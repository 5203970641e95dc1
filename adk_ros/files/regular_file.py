# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read files that come from somebody else: regular ones only, and not more than expected."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from adk_ros.errors import UsageError


def read_regular_file(path: Path, limit: int) -> bytes:
    """
    Return the content of a regular file of at most `limit` bytes.

    A device or a pipe, also behind a link, is not read: that may never end.
    :raises UsageError: it is another kind of file, or larger.
    :raises OSError: it cannot be opened or read.
    """
    # Without O_NONBLOCK, opening a pipe waits for a writer.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        about = os.fstat(descriptor)
        if not stat.S_ISREG(about.st_mode):
            raise UsageError(f"{path} is not a regular file")
        if about.st_size > limit:
            raise UsageError(
                f"{path} has {about.st_size / 2**20:.1f} MiB: at most {limit / 2**20:.0f} MiB"
            )
        content = file.read(limit + 1)
    if len(content) > limit:
        raise UsageError(f"{path} grows while it is read: at most {limit / 2**20:.0f} MiB")
    return content
