# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiling inner loops with numba, and keeping the cache of machine code honest."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba  # type: ignore[import-untyped, unused-ignore]


def compiler(folder: Path, **options: Any) -> Callable[[Any], Any]:
    """
    Return a decorator: numba's `njit` with `options`, kept on disk.

    Numba watches only the file that a function stands in, and what it calls from other files is
    compiled into it: a changed callee would go unnoticed by its cached caller. So the cache is
    keyed by all sources in `folder`. Where numba offers no place for that key, or finds no folder
    that it may write to, nothing is kept and each start compiles anew.
    """
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*.py")):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    key = digest.hexdigest()

    def decorate(function: Any) -> Any:
        compiled: Any = numba.njit(**options)(function)
        try:
            compiled.enable_caching()
            index = compiled._cache._cache_file
            index._source_stamp = (index._source_stamp, key)
        except (AttributeError, RuntimeError):
            compiled = numba.njit(**options)(function)
        return compiled

    return decorate
