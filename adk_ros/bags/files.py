# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Find the storage files of a bag, in their order."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from ruamel.yaml import YAML

from adk_ros.errors import UsageError

_STORAGE_SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")


def storage_files(path: Path, warn: Callable[[str], None]) -> tuple[list[Path], int | None]:
    """
    Return a bag's storage files, and their message count by `metadata.yaml`, if known.

    :raises UsageError: `path` does not exist, is not a bag, or contains several bags.
    """
    if path.name == "metadata.yaml":
        path = path.parent
    try:
        if not path.exists():
            raise UsageError(f"bag {path} does not exist")
        if path.is_file():
            return [path], None
        present = sorted((x for x in path.iterdir() if x.is_file()), key=_natural)
    except OSError as error:
        raise UsageError(f"bag {path}: cannot read it: {error.strerror}") from None
    stored = [x for x in present if x.name.endswith(_STORAGE_SUFFIXES)]
    # Playing a compressed bag leaves the decompressed file next to the compressed one.
    names = {x.name for x in stored}
    stored = [x for x in stored if x.suffix != ".zstd" or x.stem not in names]
    if not stored:
        others = [x.name for x in present if x.suffix == ".bag"]
        others += sorted(x.parent.name for x in path.glob("*/metadata.yaml"))
        hint = f"name a bag in it: {', '.join(others[:5])}" if others else "no .mcap or .db3 in it"
        raise UsageError(f"{path} is not a rosbag2 folder: {hint}")
    try:
        about = YAML(typ="safe").load(path / "metadata.yaml")["rosbag2_bagfile_information"]
        listed = [path / Path(x).name for x in about["relative_file_paths"]]
        expected = int(about["message_count"])
    except FileNotFoundError:
        # The file names of one recording differ only in their number.
        if len({(re.sub(r"_\d+$", "", x.stem), x.suffix) for x in stored}) > 1:
            shown = ", ".join(x.name for x in stored[:5])
            raise UsageError(f"{path} contains several recordings: name one of {shown}") from None
        warn("metadata.yaml is missing: the recording was not closed")
        return stored, None
    except Exception:  # untrusted file: its parser may raise any exception
        warn("metadata.yaml cannot be parsed: the bag is read without it")
        return stored, None
    missing = [x.name for x in listed if not x.is_file()]
    if missing or not listed:
        shown = ", ".join(missing) or "no file"
        warn(f"metadata.yaml lists {shown}: only the files present are read")
        return stored, expected
    return listed, expected


def _natural(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that orders bag_2 before bag_10."""
    return [(int(x), "") if x.isdigit() else (0, x) for x in re.split(r"(\d+)", path.name)]
