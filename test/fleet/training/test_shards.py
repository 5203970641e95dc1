# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shards: what is written is read again, in part and unchanged, or refused with one line."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.train import record

from adk_ros.errors import UsageError
from adk_ros.fleet.training.shards import read_rows, write_shard


def test_rows_are_those_of_the_record(tmp_path) -> None:
    of = record("town", 30.0)
    name = write_shard(of, tmp_path / "shards")
    read = read_rows(tmp_path / "shards" / name, 100, 900, "drive 1", ("v_y",))
    part = of.rows(slice(100, 900))
    for field in ("x", "u", "a", "x_ref", "flags", "episode"):
        np.testing.assert_array_equal(getattr(read, field), getattr(part, field))
    np.testing.assert_array_equal(np.diff(read.stamp_ns), np.diff(part.stamp_ns))
    assert (read.name, read.estimated) == ("drive 1", ("v_y",))
    assert read.flags.dtype == part.flags.dtype


def test_equal_records_share_a_shard(tmp_path) -> None:
    of = record("town", 30.0)
    first = write_shard(of, tmp_path)
    written = (tmp_path / first).stat().st_mtime_ns
    assert write_shard(of.rows(slice(None)), tmp_path) == first
    assert (tmp_path / first).stat().st_mtime_ns == written
    assert write_shard(of.rows(slice(0, 500)), tmp_path) != first
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".npy", ".npy"]


@pytest.mark.parametrize(
    ("content", "said"),
    [(None, "No such file"), (b"", "cannot be read"), (b"cut", "cannot be read")],
)
def test_an_unreadable_shard_is_refused(tmp_path, content, said) -> None:
    path = tmp_path / "x.npy"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UsageError, match=said):
        read_rows(path, 0, 10, "")


def test_a_shard_of_other_rows_is_refused(tmp_path) -> None:
    np.save(tmp_path / "x.npy", np.zeros((5, 12)))
    with pytest.raises(UsageError, match="no rows 0 to 10"):
        read_rows(tmp_path / "x.npy", 0, 10, "")
    np.save(tmp_path / "y.npy", np.zeros((50, 3)))
    with pytest.raises(UsageError, match="of 12 values"):
        read_rows(tmp_path / "y.npy", 0, 10, "")
