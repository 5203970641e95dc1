# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rules for output paths: never overwrite unasked, and write a folder completely or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from adk_ros.errors import UsageError


def refuse_existing(
    path: Path, force: bool = False, *, result_files: Sequence[str] | None = None
) -> None:
    """
    Raise `UsageError` if writing to `path` would overwrite something that it should not.

    Call it before the work starts. `result_files` says what `path` is:

    - None: a file. An existing file needs `force`; a folder is always refused.
    - names: a folder for a result. The names (relative paths, `*` allowed) identify an earlier
      result. An earlier result needs `force`; any other folder with files in it is always
      refused, because an earlier result is the only thing that `--force` may replace.

    A missing path and an empty folder are accepted. Hidden entries do not count.
    """
    if not os.path.lexists(path):
        return
    if result_files is None:
        if path.is_dir():
            raise UsageError(f"{path} is a folder: name a file for --out")
        if not force:
            raise UsageError(f"{path} exists already: add --force to replace it")
        return
    if not path.is_dir():
        raise UsageError(f"{path} is a file: name a folder for --out")
    try:
        empty = all(entry.name.startswith(".") for entry in path.iterdir())
        earlier_result = any(any(path.glob(name)) for name in result_files)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}") from None
    if earlier_result and not force:
        raise UsageError(f"{path} holds an earlier result: add --force to replace it")
    if not earlier_result and not empty:
        raise UsageError(
            f"{path} is not empty and holds no earlier result: name another folder for --out"
        )


def check_output_folder(out: Path) -> None:
    """Raise `UsageError` if the folder `out` cannot be created or written to."""
    existing = out.resolve()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir():
        raise UsageError(
            f"{out} cannot be written: {existing} is a file; name another folder for --out"
        )
    if not os.access(existing, os.W_OK | os.X_OK):
        raise UsageError(
            f"{out} cannot be written: no write permission for {existing}; "
            "name another folder for --out"
        )


@contextmanager
def staged_folder(
    out: Path, result_files: Sequence[str], stale_files: Sequence[str] = ()
) -> Iterator[Path]:
    """
    Yield a temporary folder; when the block ends, move its contents into `out`.

    An exception or interruption leaves `out` unchanged. From an earlier result in `out`,
    `result_files` are removed first and then `stale_files`. The new `result_files` are moved in
    last, in the given order: where they exist, the result is complete. Folders are replaced as
    wholes. Raises `UsageError` if `out` cannot be written.
    """
    target = out.resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        scratch_parent = target if target.is_dir() else target.parent
        # The temporary folder is readable by its owner only; the folder inside it, which becomes
        # the result, has the usual permissions.
        with tempfile.TemporaryDirectory(prefix=".report_", dir=scratch_parent) as scratch:
            staged = Path(scratch) / "report"
            staged.mkdir()
            yield staged
            if not target.exists():
                os.replace(staged, target)
                return
            for name in (*result_files, *stale_files):
                (target / name).unlink(missing_ok=True)
            names = [path.name for path in staged.iterdir()]
            others = [name for name in names if name not in result_files]
            for name in (*others, *(name for name in result_files if name in names)):
                if (target / name).is_dir():
                    shutil.rmtree(target / name)
                os.replace(staged / name, target / name)
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror or error}") from None
