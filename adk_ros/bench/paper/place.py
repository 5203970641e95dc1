# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A report goes into its folder whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def into_place(out: Path, last: str) -> Iterator[Path]:
    """
    Yield a folder to write into; in the end all in it replaces what `out` has under those names.

    An exception leaves `out` as it was. The file `last` is taken away first and comes last, so
    that where it is, all that belongs to it is there too.
    """
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".report_", dir=out) as name:
        staged = Path(name)
        yield staged
        (out / last).unlink(missing_ok=True)
        for path in sorted(staged.iterdir(), key=lambda item: item.name == last):
            target = out / path.name
            if target.is_dir():
                shutil.rmtree(target)
            path.replace(target)
