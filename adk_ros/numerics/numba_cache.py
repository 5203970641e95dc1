# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compilation with numba, with a disk cache that sees changes in other files.

Numba's own cache checks only the file in which a function is defined. Callees and constants from
other files are compiled into the caller, so that a cached caller would keep an outdated callee.
Here the key of a cache entry also covers all compiled functions that the function can reach, and
the values of the constants that they name.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, TypeVar, cast

import numba  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numba.core.dispatcher import Dispatcher  # type: ignore[import-untyped, unused-ignore]

F = TypeVar("F", bound=Callable[..., Any])


def kernel_key(compiled: Any) -> str:
    """
    Return the SHA-256 of the sources and constants that a compiled function depends on.

    Follows calls to other compiled functions across files, also through module attributes.
    """
    digest = hashlib.sha256()
    seen: set[int] = set()
    stack = [compiled]
    while stack:
        dispatcher = stack.pop()
        if id(dispatcher) in seen:
            continue
        seen.add(id(dispatcher))
        function = dispatcher.py_func
        digest.update(f"{function.__module__}.{function.__qualname__}".encode())
        digest.update(_source_digest(inspect.getfile(function)))
        for name, value in sorted(_referenced(function).items()):
            if isinstance(value, Dispatcher):
                stack.append(value)
            elif not isinstance(value, ModuleType | type) and not callable(value):
                digest.update(f"{name}={_content(value)!r}".encode())
            elif isinstance(value, type):
                # The fields of a named tuple determine which value a kernel reads.
                digest.update(f"{name}:{getattr(value, '_fields', '')}".encode())
    return digest.hexdigest()


def _content(value: Any) -> Any:
    # The repr of a long array omits its middle.
    return value.tobytes() if isinstance(value, np.ndarray) else value


@cache
def _source_digest(path: str) -> bytes:
    return hashlib.sha256(Path(path).read_bytes()).digest()


def _referenced(function: Any) -> dict[str, Any]:
    """Return name -> value of the globals and module attributes that a function refers to."""
    names: set[str] = set()
    stack: list[CodeType] = [function.__code__]
    while stack:
        code = stack.pop()
        names.update(code.co_names)
        stack.extend(c for c in code.co_consts if isinstance(c, CodeType))
    found: dict[str, Any] = {}
    for name in names:
        if name not in function.__globals__:
            continue
        value = function.__globals__[name]
        found[name] = value
        if isinstance(value, ModuleType) and value.__name__.split(".")[0] != "numpy":
            found.update(
                {
                    f"{name}.{attribute}": getattr(value, attribute)
                    for attribute in names
                    if hasattr(value, attribute)
                }
            )
    if function.__closure__:
        for name, cell in zip(function.__code__.co_freevars, function.__closure__, strict=True):
            found[name] = cell.cell_contents
    return found


def compiler(**options: Any) -> Callable[[Any], Any]:
    """
    Return a decorator: numba's `njit` with `options`, with a keyed disk cache.

    Where numba's cache has no such key, or no folder is writable, every process compiles anew.
    """

    def decorate(function: Any) -> Any:
        compiled: Any = numba.njit(**options)(function)
        try:
            compiled.enable_caching()
            index = compiled._cache._cache_file
            index.__class__ = _keyed(type(index))  # type: ignore[arg-type]
            index.__dict__["_file_stamp"] = index.__dict__.pop("_source_stamp")
            index.__dict__["_dispatcher"] = compiled
        except (AttributeError, KeyError, RuntimeError, TypeError):
            compiled = numba.njit(**options)(function)
        return compiled

    return decorate


@cache
def _keyed(base: Any) -> type:
    """
    Return numba's cache index with a key that is computed when the cache is first read.

    Not at decoration, because a function may call one that is defined below it.
    """

    class KeyedIndex(base):  # type: ignore[misc]
        @property
        def _source_stamp(self) -> tuple[Any, str]:
            if "_key" not in self.__dict__:
                self.__dict__["_key"] = kernel_key(self.__dict__["_dispatcher"])
            return self.__dict__["_file_stamp"], self.__dict__["_key"]

    return KeyedIndex


_strict = compiler(fastmath=False)
_relaxed = compiler(fastmath={"contract", "reassoc", "arcp", "nsz"}, error_model="numpy")
_ordered = compiler(fastmath=False, error_model="numpy")
_fused = compiler(fastmath={"contract", "reassoc"}, error_model="numpy")
_inlined = compiler(fastmath={"contract", "reassoc"}, error_model="numpy", inline="always")


def strict_kernel(function: F) -> F:
    """Compile with IEEE arithmetic: bit-identical results on machines of one architecture."""
    return cast(F, _strict(function))


def relaxed_kernel(function: F) -> F:
    """Compile with reordered sums and reciprocal divisions: for the surrogate's equations."""
    return cast(F, _relaxed(function))


def ordered_kernel(function: F) -> F:
    """Compile as `strict_kernel`, except that a division by zero is no error: it vectorises."""
    return cast(F, _ordered(function))


def fused_kernel(function: F) -> F:
    """Compile with reordered and fused sums: for statistics."""
    return cast(F, _fused(function))


def inlined_kernel(function: F) -> F:
    """Compile as the caller, inlined: a call costs as much as a short loop."""
    return cast(F, _inlined(function))
