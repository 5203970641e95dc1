# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sensitivity of an analysis to its criteria: the decisions that another constant would change.

A decision is a rule of constants of `library.criteria` and of statistics of the data. While
`recorded_decisions` is active, each rule is also evaluated with one constant halved and doubled
at a time. An analysis in which no answer changes takes the same path through these rules; where a
constant is used elsewhere as well (to prune candidates, to shorten an expression), its result may
still differ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

Answer = TypeVar("Answer")


@dataclass
class Decisions:
    """Number of decisions that a constant takes part in, and of those that another changes."""

    total: int = 0
    changed_by_half: int = 0
    changed_by_double: int = 0


_RECORD: ContextVar[dict[str, Decisions] | None] = ContextVar("decisions", default=None)


@contextmanager
def recorded_decisions() -> Iterator[dict[str, Decisions]]:
    """Record the decisions within the context by constant."""
    record: dict[str, Decisions] = {}
    token = _RECORD.set(record)
    try:
        yield record
    finally:
        _RECORD.reset(token)


def decided(rule: Callable[..., Answer], **constants: float) -> Answer:
    """
    Return what a rule answers with its constants, given by name and passed in their order.

    The rule must have no side effect, and its answer must be comparable.
    """
    record = _RECORD.get()
    answer = rule(*constants.values())
    if record is not None:
        for name in constants:
            entry = record.setdefault(name, Decisions())
            entry.total += 1
            entry.changed_by_half += bool(answer != rule(*_scaled(constants, name, 0.5)))
            entry.changed_by_double += bool(answer != rule(*_scaled(constants, name, 2.0)))
    return answer


def _scaled(constants: Mapping[str, float], scaled: str, factor: float) -> list[float]:
    return [x * factor if name == scaled else x for name, x in constants.items()]
