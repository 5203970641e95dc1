# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fuzzing: new examples of Hypothesis until the time is used up.

`FUZZ_SECONDS` is the time of all targets together; `FUZZ_SEED` selects other examples. A failure
prints the smallest example that was found and the seed.
"""

import os
import resource
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

SECONDS = float(os.environ.get("FUZZ_SECONDS", "60"))
SEED = int(os.environ.get("FUZZ_SEED", "0"))
TARGETS = 14
"""Tests that call `fuzz`."""
SLOW_S = 20.0
"""s that no example may take: a loop without bound, or work that a length field asks for."""
_BATCH = 50
_MEMORY_BYTES = 2 << 30
"""Bytes that an example may allocate at once: bags and models of some 100 kB need far less."""

T = TypeVar("T")
EXTREMES = (0, 1, 2**7, 2**8 - 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)
"""Integers at the ends of their types."""
NUMBERS = st.one_of(
    st.floats(),
    st.sampled_from([0.0, -0.0, 1e-320, 1e308, -1e308, 1e16, 3.5e38]),
    st.floats(-1e3, 1e3),
)
"""Floats, with those at which arithmetic overflows."""


def fuzz(strategy: st.SearchStrategy[T], check: Callable[[T], None]) -> None:
    """Call `check` with examples of `strategy` for a share of the time, at least one batch."""
    end_s = time.monotonic() + SECONDS / TARGETS
    batch = 0

    def timed(example: T) -> None:
        # Once the time is used up, the rest of a batch passes without being tried.
        begin_s = time.monotonic()
        if begin_s > end_s and not failed:
            return
        try:
            with limited_memory():
                check(example)
            taken_s = time.monotonic() - begin_s
            assert taken_s < SLOW_S, f"took {taken_s:.0f} s"
        except BaseException:
            failed.append(True)
            raise

    failed: list[bool] = []
    while batch == 0 or time.monotonic() < end_s:
        run: Any = given(strategy)(timed)
        run = settings(
            max_examples=_BATCH,
            derandomize=False,
            print_blob=True,
            suppress_health_check=list(HealthCheck),
        )(run)
        try:
            seed(1_000_000 * SEED + batch)(run)()
        except BaseException:
            print(f"FUZZ_SEED={SEED}, batch {batch}")
            raise
        batch += 1


@contextmanager
def limited_memory() -> Iterator[None]:
    """Refuse allocations beyond what an example may need."""
    with open("/proc/self/statm") as statm:
        used = int(statm.read().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + _MEMORY_BYTES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


Edit = tuple[str, int, int, bytes]
"""Kind, place, second place or length, new bytes."""


def byte_edits(most: int = 4) -> st.SearchStrategy[list[Edit]]:
    """Return edits for `edited_bytes`, which say less in a failure than the bytes themselves."""
    number = st.builds(
        lambda value, size, step: struct.pack("<Q", value)[:size][::step],
        st.sampled_from(EXTREMES), st.sampled_from([1, 2, 4, 8]), st.sampled_from([1, -1]),
    )  # fmt: skip
    kinds = st.sampled_from(["overwrite", "insert", "remove", "copy", "cut"])
    places = st.integers(0, 2**24)
    new = st.one_of(number, st.binary(min_size=1, max_size=8))
    return st.lists(st.tuples(kinds, places, places, new), min_size=1, max_size=most)


def edited_bytes(content: bytes, edits: list[Edit]) -> bytes:
    """Return `content` with parts overwritten, inserted, removed, copied or cut off."""
    out = bytearray(content)
    for kind, place, other, new in edits:
        at, length = place % (len(out) + 1), 1 + other % 64
        if kind == "overwrite":
            out[at : at + len(new)] = new
        elif kind == "insert":
            out[at:at] = new
        elif kind == "remove":
            del out[at : at + length]
        elif kind == "copy":
            source = other % (len(out) + 1)
            out[at : at + 64] = out[source : source + 64]
        elif place % 2:
            del out[at:]
    return bytes(out)


def any_value() -> st.SearchStrategy[Any]:
    """Return values that JSON and YAML can hold, nested lists and mappings included."""
    scalars = st.one_of(
        st.none(), st.booleans(), NUMBERS, st.integers(), st.sampled_from(EXTREMES),
        st.text(max_size=8), st.just("9" * 5000), st.just("\u202e\x00\n\r"),
    )  # fmt: skip
    keys = st.text(max_size=8)
    nested = st.recursive(
        scalars,
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(keys, inner, max_size=3),
        max_leaves=8,
    )
    return st.one_of(scalars, nested, st.just(_nested(500)))


def _nested(depth: int) -> Any:
    content: Any = 1
    for _ in range(depth):
        content = [content]
    return content


@st.composite
def edited_content(draw: st.DrawFn, content: Any, edits: int = 3) -> Any:
    """Return a copy of nested mappings and lists in which values are replaced, or keys removed."""
    for _ in range(draw(st.integers(1, edits))):
        path = draw(st.sampled_from(_paths(content)))
        kind = draw(st.sampled_from(["replace", "replace", "scale", "remove", "rename", "repeat"]))
        content = _edited(content, path, kind, draw)
    return content


def _paths(content: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    keys: Any = ()
    if isinstance(content, dict):
        keys = content
    elif isinstance(content, list):
        keys = range(len(content))
    return [path, *(found for key in keys for found in _paths(content[key], (*path, key)))]


def _edited(content: Any, path: tuple[Any, ...], kind: str, draw: st.DrawFn) -> Any:
    if not path:
        return _replaced(content, kind, draw)
    key, rest = path[0], path[1:]
    copied = dict(content) if isinstance(content, dict) else list(content)
    if rest or kind not in {"remove", "rename"}:
        copied[key] = _edited(content[key], rest, kind, draw)
        return copied
    value = copied.pop(key)
    if kind == "rename" and isinstance(copied, dict):
        copied[draw(st.text(max_size=6))] = value
    return copied


def _replaced(content: Any, kind: str, draw: st.DrawFn) -> Any:
    if kind == "scale" and isinstance(content, int | float):
        return content * draw(st.sampled_from([-1.0, 0.0, 1e-9, 1.001, 10.0, 1e9]))
    if kind == "repeat" and isinstance(content, list):
        return content * draw(st.sampled_from([0, 2, 50]))
    return draw(any_value())


def assert_one_line(text: str) -> None:
    """Require one line without control characters, not too long to read."""
    assert text.strip()
    assert text.isprintable(), ascii(text)
    assert len(text) < 2000, len(text)
