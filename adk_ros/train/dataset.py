# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Split records into training, validation and test parts, by blocks of time or by whole bags.

Neighbouring rows of a recording are correlated, so rows drawn at random would test on training
data. Blocks are longer than the horizon, and no sequence crosses a block boundary.
"""

from __future__ import annotations

import hashlib
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
VEHICLES = "vehicles"
"""Split of a fleet, by vehicle (`api.fleet.training_data`): its records are blocks."""
_PATTERN = (TRAIN, TRAIN, VALIDATION, TRAIN, TEST, TRAIN, TRAIN, TRAIN, TEST, TRAIN)
"""Parts of successive blocks: 7 of 10 for training, 1 for validation, 2 for testing."""
_MAX_BLOCK_S = 30.0
_MIN_BLOCK_S = 6.0
"""A block of 6 s holds sequences of 2 s horizon; blocks over 30 s would test on too few places."""
_BLOCKS_PER_RECORDING = 40.0
"""Each recording is cut into about this many blocks, so that the test covers different roads."""
_TAIL_SHARES = (0.7, 0.1)
"""Shares of training and validation in a "tail" split; the rest is the test."""
_VALIDATION_SHARE = 0.1
"""Share at the end of each training bag that validates in a "bags" split."""


@dataclass(frozen=True)
class Split:
    """Records and the part of each row (n,): `TRAIN`, `VALIDATION` or `TEST`."""

    records: list[Record]
    parts: list[IntArray]
    kind: str

    def of(self, part: int) -> list[Record]:
        """Return the records of one part; each block is an episode, which no sequence crosses."""
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
        """Return the duration of a part, s."""
        return sum(float((parts == part).sum()) for parts in self.parts) * TICK_NS * 1e-9


def split_records(records: Sequence[Record], kind: str = "blocks") -> Split:
    """
    Assign every row of every record to a part.

    "blocks": blocks of 6 to 30 s; of every ten, counted over all recordings, seven train, one
    validates and two test. "tail":
    the first 70 % of each bag train, the next 10 % validate, the last 20 % test. "bags": the last
    bag is the test, and the last tenth of each other bag validates.

    :raises UsageError: the kind is unknown, "bags" has fewer than two bags, or two records are
        equal.
    """
    if kind not in SPLITS:
        raise UsageError(f"split '{kind}' is unknown: choose one of {', '.join(SPLITS)}")
    if kind == "bags" and len(records) < 2:
        raise UsageError("--split bags needs at least two bags: the last one is the test")
    _refuse_duplicates(records)
    parts: list[IntArray] = []
    blocks = 0
    for number, record in enumerate(records):
        n = len(record)
        row = np.arange(n)
        if kind == "blocks":
            block_s = np.clip(
                record.duration_s / _BLOCKS_PER_RECORDING, _MIN_BLOCK_S, _MAX_BLOCK_S
            )
            length = int(block_s / (TICK_NS * 1e-9))
            # Continued over the recordings: short ones would all train, and none of them test.
            count = max(round(n / length), 1)
            # What is left is part of the last block: it may be short.
            number_of_block = np.minimum(row // length, count - 1)
            part = np.array(_PATTERN)[(blocks + number_of_block) % len(_PATTERN)]
            blocks += count
        elif kind == "tail":
            part = np.digitize(row, np.cumsum(_TAIL_SHARES) * n)
        elif number == len(records) - 1:
            part = np.full(n, TEST)
        else:
            part = np.where(row < (1.0 - _VALIDATION_SHARE) * n, TRAIN, VALIDATION)
        parts.append(part.astype(np.int64))
    return Split(list(records), parts, kind)


def _refuse_duplicates(records: Sequence[Record]) -> None:
    """Raise UsageError if two records have the same content, under whatever names and stamps."""
    seen: dict[str, tuple[int, str]] = {}
    for number, record in enumerate(records, 1):
        digest = hashlib.sha256()
        for array in (record.x, record.u, record.a, record.x_ref, record.flags, record.episode):
            digest.update(f"{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        first = seen.setdefault(digest.hexdigest(), (number, record.name))
        if first[0] != number:
            raise UsageError(
                f"recordings {first[0]} ({first[1]}) and {number} ({record.name}) are identical: "
                "test data must not be training data; give each recording once"
            )


@dataclass(frozen=True)
class Sequences:
    """
    Joined records, and the rows from which a sequence can be rolled out.

    `x`, `x_ref` (n, 3), `u` (n, 2): all records; `rows` (m,): starts with `history` rows before
    and `ahead` rows after them in the same episode.
    """

    x: FloatArray
    x_ref: FloatArray
    u: FloatArray
    rows: IntArray
    history: int
    ahead: int


def sequences(records: Sequence[Record], history: int, ahead: int, what: str) -> Sequences:
    """
    Join `records` and find the rows at which sequences start.

    :raises DataError: there are none; `what` names the part in the message.
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
            "give longer recordings, or check odometry and commands for gaps"
        )
    return Sequences(
        x=np.concatenate([r.x for r in records]),
        x_ref=np.concatenate([r.x_ref for r in records]),
        u=np.concatenate([r.u for r in records]),
        rows=joined,
        history=history,
        ahead=ahead,
    )
