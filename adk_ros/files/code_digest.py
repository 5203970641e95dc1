# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Identify the code that a figure was measured with."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path


@cache
def code_digest() -> str:
    """Return a hash (64 hexadecimal digits) of the Python sources of the package."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()
