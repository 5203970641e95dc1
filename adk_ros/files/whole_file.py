# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files that several processes may write, and that appear whole or not at all."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """
    Yield a file that takes the place of `path` at the end of the block; an error leaves nothing.

    Its name until then is unique, also among processes of other machines.

    :raises OSError: the file cannot be written.
    """
    scratch = path.with_name(f".{uuid.uuid4().hex}")
    try:
        with scratch.open("wb") as file:
            yield file
        os.replace(scratch, path)
    finally:
        scratch.unlink(missing_ok=True)
