# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Records cut into training, validation and test parts, by blocks of time or by whole bags.

Rows of one drive resemble their neighbours, so a split by rows would test on what was trained on.
Blocks are long against the horizon, and no sequence reaches from one block into another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.errors import DataError, UsageError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import TICK_NS, Record
from adk_ros.signals.score import scorable_rows

TRAIN, VALIDATION, TEST = 0, 1, 2
PARTS = ("train", "validation", "test")
SPLITS = ("blocks", "tail", "bags")
_PATTERN = (TRAIN, TRAIN, VALIDATION, TRAIN, TEST, TRAIN, TRAIN, TRAIN, TEST, TRAIN)
_LONGEST_BLOCK_S = 30.0
_SHORTEST_BLOCK_S = 6.0
_TAIL_SHARES = (0.7, 0.1)


@dataclass(frozen=True)
class Split:
    """Records, each with its rows' parts (n,): `TRAIN`, `VALIDATION` or `TEST`."""

    records: list[Record]
    parts: list[IntArray]
    kind: str

    def of(self, part: int) -> list[Record]:
        """The records of one part: each block an episode of its own, so that none is crossed."""
        chosen = []
        for record, parts in zip(self.records, self.parts, strict=True):
            rows = parts == part
            if not rows.any():
                continue
            change = (np.diff(parts) != 0) | (np.diff(record.episode) != 0)
            breaks = np.concatenate([[False], change])
            chosen.append(replace(record, episode=np.cumsum(breaks)).rows(rows))
        return chosen

    def seconds(self, part: int) -> float:
        """How much of the data is in a part."""
        return sum(float((parts == part).sum()) for parts in self.parts) * TICK_NS * 1e-9


def split_records(records: Sequence[Record], kind: str = "blocks") -> Split:
    """
    Assign every row of every record to a part.

    "blocks": blocks of up to 30 s, of each ten seven to train on, one to validate, two to test on.
    A drive is cut into about forty, so that the test meets more than one kind of road. "tail": the
    first 70 % in time of each bag, the next 10 %, the last 20 %.
    "bags": the last bag is the test, and a tenth of each other one, its end, the validation.

    :raises UsageError: the kind is unknown, or "bags" with fewer than two bags.
    :raises DataError: too little data for the parts.
    """
    if kind not in SPLITS:
        raise UsageError(f"split '{kind}' is unknown: choose one of {', '.join(SPLITS)}")
    if kind == "bags" and len(records) < 2:
        raise UsageError("--split bags needs at least two bags: the last one is the test")
    parts: list[IntArray] = []
    for number, record in enumerate(records):
        n = len(record)
        row = np.arange(n)
        if kind == "blocks":
            block_s = np.clip(record.duration_s / 40.0, _SHORTEST_BLOCK_S, _LONGEST_BLOCK_S)
            length = int(block_s / (TICK_NS * 1e-9))
            part = np.array(_PATTERN)[(row // length) % len(_PATTERN)]
        elif kind == "tail":
            part = np.digitize(row, np.cumsum(_TAIL_SHARES) * n)
        elif number == len(records) - 1:
            part = np.full(n, TEST)
        else:
            part = np.where(row < 0.9 * n, TRAIN, VALIDATION)
        parts.append(part.astype(np.int64))
    return Split(list(records), parts, kind)


@dataclass(frozen=True)
class Sequences:
    """
    Rows of joined records from which a sequence can be rolled out.

    `x`, `x_ref` (n, 3), `u` (n, 2): all records in one; `rows` (m,): starts, with `history` rows
    before and `ahead` after them in the same episode.
    """

    x: FloatArray
    x_ref: FloatArray
    u: FloatArray
    rows: IntArray
    history: int
    ahead: int


def sequences(records: Sequence[Record], history: int, ahead: int, what: str) -> Sequences:
    """
    Join `records` and find the starts.

    :raises DataError: there is none; `what` names the part in the message.
    """
    offset = 0
    rows = []
    for record in records:
        rows.append(scorable_rows(record, history, ahead) + offset)
        offset += len(record)
    joined = np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
    if joined.size == 0:
        raise DataError(
            f"no {what} sequence of {(history + ahead) * TICK_NS * 1e-9:.2f} s without a gap: "
            "give longer recordings, or check that odometry and commands have no holes"
        )
    return Sequences(
        x=np.concatenate([r.x for r in records]),
        x_ref=np.concatenate([r.x_ref for r in records]),
        u=np.concatenate([r.u for r in records]),
        rows=joined,
        history=history,
        ahead=ahead,
    )
