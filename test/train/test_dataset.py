# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The split: by time and never by rows, with nothing that reaches from one part into another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.train import made_record
from hypothesis import given
from hypothesis import strategies as st

from adk_ros.errors import DataError, UsageError
from adk_ros.signals.channels import TICK_NS, Flag, Record
from adk_ros.train.dataset import (
    PARTS,
    SPLITS,
    TEST,
    TRAIN,
    VALIDATION,
    Split,
    sequences,
    split_records,
)

HISTORY, AHEAD = 5, 60
SIX_SECONDS = 240


def drive(n: int, seed: int = 0, name: str = "made") -> Record:
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(0.0, 0.01, (n, 3)), axis=0)
    return made_record(x, rng.normal(0.0, 1.0, (n, 2)), name=name)


def runs(parts: np.ndarray) -> list[tuple[int, int]]:
    """(part, length) of each stretch of equal parts."""
    edges = np.flatnonzero(np.diff(parts)) + 1
    return [(int(piece[0]), len(piece)) for piece in np.split(parts, edges)]


def windows(split: Split, part: int) -> list[set[tuple[int, int]]]:
    """(record, row) of everything that each sequence of a part touches."""
    found = []
    chosen = split.of(part)
    if not chosen:
        return []
    # A record's name tells it in the joined rows, a stamp its row.
    owner = np.concatenate([np.full(len(r), int(r.name)) for r in chosen])
    row = np.concatenate([(r.stamp_ns - split.records[0].stamp_ns[0]) // TICK_NS for r in chosen])
    for start in sequences(chosen, HISTORY, AHEAD, "some").rows:
        touched = range(start - HISTORY, start + AHEAD + 1)
        found.append({(int(owner[i]), int(row[i])) for i in touched})
    return found


@given(n=st.integers(1, 60_000))
def test_blocks_are_long_stretches_of_time(n: int) -> None:
    record = made_record(np.zeros((n, 3)))
    (parts,) = split_records([record]).parts
    assert parts.shape == (n,)
    assert set(np.unique(parts)) <= {TRAIN, VALIDATION, TEST}
    stretches = runs(parts)
    assert all(length >= SIX_SECONDS for _, length in stretches[:-1])
    assert stretches[0][0] == TRAIN


@pytest.mark.parametrize("seconds", [60, 120, 300, 1400])
def test_shares_of_the_blocks(seconds: int) -> None:
    split = split_records([drive(seconds * 40)])
    shares = [split.seconds(part) / seconds for part in range(len(PARTS))]
    assert sum(shares) == pytest.approx(1.0)
    assert 0.6 <= shares[TRAIN] <= 0.85
    assert 0.05 <= shares[VALIDATION] <= 0.2
    assert 0.1 <= shares[TEST] <= 0.3


@pytest.mark.parametrize("kind", SPLITS)
def test_no_sequence_touches_two_parts_or_two_bags(kind: str) -> None:
    records = [drive(4000, 1, "0"), drive(2600, 2, "1")]
    broken = np.zeros(4000, dtype=np.int64)
    broken[1500:] = 1
    records[0] = replace(records[0], episode=broken)
    split = split_records(records, kind)
    part_of = {
        (number, row): int(part)
        for number, parts in enumerate(split.parts)
        for row, part in enumerate(parts)
    }
    touched = []
    for part in (TRAIN, VALIDATION, TEST):
        found = windows(split, part)
        assert found, PARTS[part]
        for window in found:
            assert len(window) == HISTORY + AHEAD + 1
            assert {part_of[place] for place in window} == {part}
            assert len({number for number, _ in window}) == 1
            rows = sorted(row for _, row in window)
            assert rows == list(range(rows[0], rows[-1] + 1))
            number = next(iter(window))[0]
            assert number == 1 or rows[-1] < 1500 or rows[0] >= 1500
        touched.append(set.union(*found))
    assert not (touched[TRAIN] & touched[VALIDATION])
    assert not (touched[TRAIN] & touched[TEST])
    assert not (touched[VALIDATION] & touched[TEST])


@pytest.mark.parametrize(("seconds", "count"), [(6.5, 40), (8.0, 40), (12.0, 10), (20.0, 50)])
def test_short_recordings_have_all_parts(seconds: float, count: int) -> None:
    """Of one or a few blocks each: the pattern goes on over the recordings."""
    n = round(seconds / (TICK_NS * 1e-9))
    split = split_records([drive(n, seed=k) for k in range(count)])
    whole = seconds * count
    assert split.seconds(TRAIN) == pytest.approx(0.7 * whole, rel=0.12)
    assert split.seconds(VALIDATION) == pytest.approx(0.1 * whole, rel=0.5)
    assert split.seconds(TEST) == pytest.approx(0.2 * whole, rel=0.3)


def test_parts_return_each_row_once_and_in_order() -> None:
    split = split_records([drive(5000, name="0")])
    for part in (TRAIN, VALIDATION, TEST):
        stamps = np.concatenate([r.stamp_ns for r in split.of(part)])
        np.testing.assert_array_equal(stamps, split.records[0].stamp_ns[split.parts[0] == part])
        assert split.seconds(part) == pytest.approx(len(stamps) * 0.025)


def test_tail_is_the_end_of_each_bag() -> None:
    for parts in split_records([drive(1000), drive(2000)], "tail").parts:
        n = len(parts)
        assert [p for p, _ in runs(parts)] == [TRAIN, VALIDATION, TEST]
        lengths = np.array([length for _, length in runs(parts)])
        np.testing.assert_allclose(lengths / n, [0.7, 0.1, 0.2], atol=1.5 / n)


def test_bags_hold_out_the_last_one() -> None:
    split = split_records([drive(1000), drive(600), drive(800)], "bags")
    assert (split.parts[2] == TEST).all()
    for parts in split.parts[:2]:
        assert [p for p, _ in runs(parts)] == [TRAIN, VALIDATION]
        assert (parts == TRAIN).mean() == pytest.approx(0.9, abs=0.01)


def test_invalid_splits_are_refused() -> None:
    with pytest.raises(UsageError, match="split 'rows' is unknown: choose one of blocks, tail, b"):
        split_records([drive(1000)], "rows")
    with pytest.raises(UsageError, match="at least two bags"):
        split_records([drive(1000)], "bags")


@pytest.mark.parametrize("kind", SPLITS)
def test_identical_recordings_are_refused(kind: str) -> None:
    town, other = drive(1000, 1, "town"), drive(1000, 2, "other")
    copy = replace(drive(1000, 1, "copy"), stamp_ns=town.stamp_ns + 10**12)
    with pytest.raises(UsageError, match=r"^recordings 1 \(town\) and 2 \(town\) are identical: "):
        split_records([town, town], kind)
    with pytest.raises(UsageError, match=r"^recordings 1 \(town\) and 3 \(copy\) are identical: "):
        split_records([town, other, copy], kind)
    x = town.x.copy()
    x[500, 0] += 1e-9
    assert len(split_records([town, other, replace(copy, x=x)], kind).records) == 3


def test_sequences_avoid_unknown_and_stale_samples() -> None:
    record = drive(1000)
    flags, u, x_ref = record.flags.copy(), record.u.copy(), record.x_ref.copy()
    flags[300] = int(Flag.ODOMETRY_STALE)
    u[500, 1] = np.nan
    x_ref[700, 0] = np.nan
    bad = replace(record, flags=flags, u=u, x_ref=x_ref)
    rows = sequences([bad], HISTORY, AHEAD, "some").rows
    assert rows.size
    for start in rows:
        assert not start - HISTORY <= 300 <= start
        assert not start <= 500 <= start + AHEAD
        assert not start <= 700 <= start + AHEAD
    # What is flagged may well lie ahead: it is measured, if not to be learned from.
    assert {299, 301 + HISTORY} <= set(rows.tolist())


def test_too_short_records_are_refused_in_one_line() -> None:
    with pytest.raises(DataError) as caught:
        sequences([drive(HISTORY + AHEAD)], HISTORY, AHEAD, "validation")
    said = str(caught.value)
    assert "no validation sequence of 1.62 s without a gap" in said
    assert "\n" not in said
    with pytest.raises(DataError, match="no training sequence"):
        sequences([], HISTORY, AHEAD, "training")
