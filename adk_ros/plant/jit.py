# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The one place where the plant's kernels are compiled, and where their cache is kept honest."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba  # type: ignore[import-untyped, unused-ignore]

F = TypeVar("F", bound=Callable[..., Any])


def _sources_digest() -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


_DIGEST = _sources_digest()


def kernel(function: F) -> F:
    """
    Compile `function` to machine code at its first call and keep the result on disk.

    Without `fastmath`, so that a drive is the same to the last bit on every machine of a kind.
    Numba watches only the file that a function stands in, and what it calls from other files is
    compiled into it: a changed tyre would go unnoticed by the cached car. So the cache is keyed by
    the sources of the whole plant. Where numba offers no place for that key, or finds no folder
    that it may write to, nothing is cached.
    """
    compiled: Any = numba.njit(fastmath=False)(function)
    try:
        compiled.enable_caching()
        index = compiled._cache._cache_file
        index._source_stamp = (index._source_stamp, _DIGEST)
    except (AttributeError, RuntimeError):
        compiled = numba.njit(fastmath=False)(function)
    return cast(F, compiled)
