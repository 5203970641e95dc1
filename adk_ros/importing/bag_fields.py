# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read numeric fields of any message of a bag: one table per topic."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adk_ros.bags import Bag
from adk_ros.errors import DataError
from adk_ros.importing.table import Clock, Table

_MAX_DEPTH = 8
_MAX_ELEMENTS = 64
"""Elements of an array that become columns: more are an image or a scan."""

_Step = str | int
"""Part of the path to a field: an attribute or an index."""


def read_bag_tables(path: Path, notes: list[str]) -> list[Table]:
    """
    Return the tables of a bag; a column is named `/topic.field.sub[0]`.

    The clock is the header stamp, or the log time of a message without one. The fields are those
    of the topic's first message; warnings of the bag are added to `notes`.

    :raises UsageError: the path is no bag. :raises DataError: it has no numeric field.
    """
    tables = []
    with Bag(path) as bag:
        for topic in (info.name for info in bag.topics if info.count):
            try:
                first = next(bag.messages([topic]), None)
            except DataError as error:
                notes.append(f"{path.name}: {topic} is not read: {error}")
                continue
            if first is None:
                continue
            fields = {f"{topic}.{_text(steps)}": steps for steps in _numeric(first[2], (), 0)}
            if fields:
                tables.append(_table(path, topic, fields))
        notes += bag.warnings
    if not tables:
        raise DataError(f"bag {path}: no topic has a numeric field")
    return tables


def _table(path: Path, topic: str, fields: dict[str, tuple[_Step, ...]]) -> Table:
    def load(wanted: Sequence[str]) -> dict[str, NDArray[Any]]:
        rows = [[_value(msg, fields[name]) for name in wanted] for _, msg in _messages()]
        values = np.array(rows, dtype=np.float64).reshape(len(rows), len(wanted))
        return {name: values[:, i] for i, name in enumerate(wanted)}

    @lru_cache(maxsize=1)
    def clock() -> Clock:
        stamps = [_stamp_ns(log_ns, msg) for log_ns, msg in _messages()]
        return Clock(np.array(stamps, dtype=np.int64), True)

    def _messages() -> Iterator[tuple[int, Any]]:
        with Bag(path) as bag:
            for _, log_ns, msg in bag.messages([topic]):
                yield log_ns, msg

    return Table(path, topic, tuple(fields), load, {}, clock)


def _stamp_ns(log_ns: int, msg: Any) -> int:
    """Return the header stamp; the log time if there is no header or it is zero."""
    header = getattr(msg, "header", msg)
    stamp = getattr(header, "stamp", None)
    stamp_ns = 0 if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)
    return stamp_ns or log_ns


def _numeric(value: Any, path: tuple[_Step, ...], depth: int) -> Iterator[tuple[_Step, ...]]:
    """Yield the paths to the numbers of a message."""
    if isinstance(value, bool | int | float | np.number):
        yield path
    elif isinstance(value, np.ndarray | list | tuple):
        if len(value) <= _MAX_ELEMENTS and depth < _MAX_DEPTH:
            for i, item in enumerate(value):
                yield from _numeric(item, (*path, i), depth + 1)
    elif hasattr(value, "__dataclass_fields__") and depth < _MAX_DEPTH:
        for name in value.__dataclass_fields__:
            if not name.startswith("_"):
                yield from _numeric(getattr(value, name), (*path, name), depth + 1)


def _value(msg: Any, path: tuple[_Step, ...]) -> float:
    """Return a field of a message; NaN if a shorter array lacks it."""
    value = msg
    for step in path:
        if isinstance(step, str):
            value = getattr(value, step)
        elif step < len(value):
            value = value[step]
        else:
            return float("nan")
    return float(value)


def _text(path: tuple[_Step, ...]) -> str:
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)[1:]
