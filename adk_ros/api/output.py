# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Output paths of the Python interface: what may be replaced, and what is never overwritten."""

from __future__ import annotations

from pathlib import Path

from adk_ros.errors import UsageError
from adk_ros.files.output_folder import refuse_existing

_METADATA = "metadata.yaml"
_BAG_CONTENT = (".mcap", ".db3", ".zstd")


def bag_files(out: Path) -> tuple[str, ...]:
    """
    Return the names that identify an earlier bag in a folder, as in `refuse_existing`.

    A process that was killed leaves a bag without metadata, whose one file is named as the folder.
    """
    return _METADATA, f"{out.name}.mcap"


def check_output(
    out: Path, force: bool, result_files: tuple[str, ...] | None, *inputs: Path
) -> None:
    """
    Refuse an output path before the work starts.

    :param result_files: names that identify an earlier result, as in `refuse_existing`.
    :param inputs: paths that the work reads; none of them may be overwritten.
    :raises UsageError: `out` exists and may not be replaced, or is one of the inputs.
    """
    for path in inputs:
        place, target = path.resolve(), out.resolve()
        if path.exists() and (place == target or target in place.parents):
            raise UsageError(f"{out} is an input as well: choose another --out")
    refuse_existing(out, force, result_files=result_files)


def _is_of_bag(file: Path) -> bool:
    """Whether a file of a bag's folder is the bag's; a map or parameters beside it are not."""
    return file.suffix in _BAG_CONTENT or file.name == _METADATA


def remove_earlier_bag(out: Path) -> None:
    """
    Remove the bag at `out`, so that a new one can be written there.

    :raises UsageError: the folder contains anything that is not part of a bag.
    """
    if not out.exists():
        return
    files = list(out.iterdir())
    # In a folder without metadata, only the file of an unfinished bag is certainly ours.
    finished, unfinished_name = (out / _METADATA).exists(), bag_files(out)[-1]
    other = [
        file.name
        for file in files
        if file.is_dir() or (not _is_of_bag(file) if finished else file.name != unfinished_name)
    ]
    if other:
        raise UsageError(f"{out} holds more than a bag ({other[0]}): choose another --out")
    for file in files:
        file.unlink()
    out.rmdir()
