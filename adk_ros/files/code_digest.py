# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Identify the code that a figure was measured with."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

_HASHED = {".py", ".yaml", ".j2"}
"""Sources, packaged vehicles and scenarios, and templates: all decide what a command writes."""


@cache
def code_digest() -> str:
    """Return a hash (64 hexadecimal digits) of the sources and data files of the package."""
    return digest_of(Path(__file__).parents[1])


def digest_of(package: Path) -> str:
    """Return the hash of the sources and data files below a folder."""
    digest = hashlib.sha256()
    for path in sorted(path for path in package.rglob("*") if path.suffix in _HASHED):
        digest.update(str(path.relative_to(package)).encode() + path.read_bytes())
    return digest.hexdigest()
