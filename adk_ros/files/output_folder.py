# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A report goes into its folder whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from adk_ros.errors import UsageError


def check_output_folder(out: Path) -> None:
    """Raise `UsageError` where no report could be written: best asked before the work is done."""
    at = out.resolve()
    while not at.exists() and at != at.parent:
        at = at.parent
    if not at.is_dir():
        raise UsageError(f"{out} cannot be written: {at} is a file; name another folder for --out")
    if not os.access(at, os.W_OK | os.X_OK):
        raise UsageError(
            f"{out} cannot be written: {at} is not yours to write; name another folder for --out"
        )


@contextmanager
def staged_folder(out: Path, last: Sequence[str], stale: Sequence[str] = ()) -> Iterator[Path]:
    """
    Yield a folder to write into; in the end all of it goes into `out`, folders as wholes.

    An exception, an interruption too, leaves `out` as it was. Of an earlier report in `out` the
    files `last` are taken away first, then those in `stale`, and the new `last` come last, in that
    order: where they are, all that belongs to them is. Raises `UsageError` where `out` cannot be
    written.
    """
    place = out.resolve()
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        beside = place if place.is_dir() else place.parent
        # A folder in the temporary one: that one is readable by nobody else.
        with tempfile.TemporaryDirectory(prefix=".report_", dir=beside) as scratch:
            staged = Path(scratch) / "report"
            staged.mkdir()
            yield staged
            if not place.exists():
                os.replace(staged, place)
                return
            for name in (*last, *stale):
                (place / name).unlink(missing_ok=True)
            names = [path.name for path in staged.iterdir()]
            for name in (*(n for n in names if n not in last), *(n for n in last if n in names)):
                if (place / name).is_dir():
                    shutil.rmtree(place / name)
                os.replace(staged / name, place / name)
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror or error}") from None
