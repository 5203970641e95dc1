# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Paths of one or several recordings, as a caller gives them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from adk_ros.errors import UsageError


def different_recordings(recording: Path | str | Sequence[Path | str]) -> list[Path]:
    """
    Return the paths of one or several recordings.

    :raises UsageError: there is none, or one is given twice.
    """
    given = [recording] if isinstance(recording, Path | str) else recording
    bags = [Path(path) for path in given]
    if not bags:
        raise UsageError("no recording: give at least one bag of the real car")
    seen: set[Path] = set()
    for bag in bags:
        if bag.resolve() in seen:
            raise UsageError(f"{bag}: given twice: give each recording once")
        seen.add(bag.resolve())
    return bags
