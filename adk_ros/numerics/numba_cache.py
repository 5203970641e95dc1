# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compile inner loops with numba, and keep machine code on disk only while its sources are the same.

Numba watches the file in which a function is defined. What the function calls from other files, and
the constants that it reads, are compiled into it, so a changed callee would go unnoticed by a cached
caller. Here a cache entry is therefore keyed by the function's own file, by the keys of all compiled
functions that it can reach, and by the values of the constants that it names.
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
    Return the SHA-256 of the sources and constants that a compiled function is made of.

    Follows calls to other compiled functions across files, through module attributes as well.
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
                # Named tuples: their fields decide where a kernel reads.
                digest.update(f"{name}:{getattr(value, '_fields', '')}".encode())
    return digest.hexdigest()


def _content(value: Any) -> Any:
    # The representation of a long array leaves its middle out.
    return value.tobytes() if isinstance(value, np.ndarray) else value


@cache
def _source_digest(path: str) -> bytes:
    return hashlib.sha256(Path(path).read_bytes()).digest()


def _referenced(function: Any) -> dict[str, Any]:
    """Return the globals and module attributes that a function's code, nested code too, names."""
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
    Return a decorator: numba's `njit` with `options`, its machine code kept on disk.

    Where numba offers no place for the key, or finds no folder that it may write to, nothing is
    kept and every process compiles anew.
    """

    def decorate(function: Any) -> Any:
        compiled: Any = numba.njit(**options)(function)
        try:
            compiled.enable_caching()
            index = compiled._cache._cache_file
            index.__class__ = _keyed(type(index))  # type: ignore[arg-type]
            index.__dict__["_own_stamp"] = index.__dict__.pop("_source_stamp")
            index.__dict__["_dispatcher"] = compiled
        except (AttributeError, KeyError, RuntimeError, TypeError):
            compiled = numba.njit(**options)(function)
        return compiled

    return decorate


@cache
def _keyed(base: Any) -> type:
    """
    Return numba's cache index with a stamp that is worked out when the cache is first read.

    Not at decoration: a function may call one that is defined below it.
    """

    class KeyedIndex(base):  # type: ignore[misc]
        @property
        def _source_stamp(self) -> tuple[Any, str]:
            if "_key" not in self.__dict__:
                self.__dict__["_key"] = kernel_key(self.__dict__["_dispatcher"])
            return self.__dict__["_own_stamp"], self.__dict__["_key"]

    return KeyedIndex


_strict = compiler(fastmath=False)
_relaxed = compiler(fastmath={"contract", "reassoc", "arcp", "nsz"}, error_model="numpy")
_fused = compiler(fastmath={"contract", "reassoc"}, error_model="numpy")
_inlined = compiler(fastmath={"contract", "reassoc"}, error_model="numpy", inline="always")


def strict_kernel(function: F) -> F:
    """Compile with IEEE arithmetic: the same result to the last bit on every machine of a kind."""
    return cast(F, _strict(function))


def relaxed_kernel(function: F) -> F:
    """Compile with sums reordered and divisions by reciprocals: for the surrogate's simulation."""
    return cast(F, _relaxed(function))


def fused_kernel(function: F) -> F:
    """Compile with sums reordered and fused: for the perceptron, which is float32 anyway."""
    return cast(F, _fused(function))


def inlined_kernel(function: F) -> F:
    """As `fused_kernel`, inlined in its callers: a call with its arrays costs as much as the loop."""
    return cast(F, _inlined(function))
