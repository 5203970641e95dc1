# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Provenance of a result: command, version, date, duration, input files with SHA-256 hashes."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from adk_ros.errors import UsageError

_CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class InputFile:
    """
    One file that a result was computed from.

    `role` says what for ("recording"); `source` is the path that the user gave, `path` the file
    itself: a bag folder has several files.
    """

    role: str
    source: str
    path: str
    size_bytes: int
    sha256: str


@dataclass(frozen=True)
class Provenance:
    """
    Command, version, start, duration and input files of a result.

    `started` is the date and time as text, with its time zone; `duration_s` ends when the page is
    written. The values come from the caller: nothing here reads a clock.
    """

    command: str
    version: str
    started: str
    duration_s: float
    inputs: tuple[InputFile, ...] = ()

    def source_name(self, role: str) -> str:
        """Return the file or folder name that the user gave for `role`; empty if none."""
        return next((Path(item.source).name for item in self.inputs if item.role == role), "")

    def parent_and_name(self, role: str) -> str:
        """Return that name with its parent folder, where the user gave one."""
        source = next((item.source for item in self.inputs if item.role == role), "")
        return "/".join(part for part in Path(source).parts[-2:] if part != "/")


def input_files(role: str, source: Path) -> tuple[InputFile, ...]:
    """
    Hash the file `source`, or every file in the folder `source`, with SHA-256.

    :raises UsageError: a file cannot be read.
    """
    try:
        paths = [source]
        if source.is_dir():
            paths = sorted(path for path in source.rglob("*") if path.is_file())
        return tuple(
            InputFile(role, str(source), str(path), path.stat().st_size, sha256_of(path))
            for path in paths
        )
    except OSError as error:
        raise UsageError(f"{source} cannot be read: {error.strerror or error}") from None


def sha256_of(path: Path) -> str:
    """Return the SHA-256 hash of a file in hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK_BYTES):
            digest.update(chunk)
    return digest.hexdigest()
