# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A kernel sees through a table the arrays that Python sees."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from adk_ros.numerics import array_table
from adk_ros.numerics.array_table import ArrayTable

READERS: dict[Callable[..., Any], Any] = {
    array_table.floats_1: np.zeros(3),
    array_table.floats_2: np.zeros((3, 2)),
    array_table.floats_3: np.zeros((3, 2, 4)),
    array_table.floats_4: np.zeros((3, 2, 4, 5)),
    array_table.singles_1: np.zeros(3, np.float32),
    array_table.singles_2: np.zeros((3, 2), np.float32),
    array_table.singles_3: np.zeros((3, 2, 4), np.float32),
    array_table.integers_1: np.zeros(3, np.int64),
}


def test_every_reader_returns_its_array() -> None:
    for array in READERS.values():
        array.ravel()[:] = np.arange(array.size)
    table = ArrayTable(*READERS.values())
    for i, (read, array) in enumerate(READERS.items()):
        seen = read(table.rows, i)
        assert (seen.shape, seen.dtype) == (array.shape, array.dtype)
        np.testing.assert_array_equal(seen, array)
        seen.ravel()[-1] = -1
        assert array.ravel()[-1] == -1


def test_an_array_that_is_not_contiguous_is_refused() -> None:
    with pytest.raises(ValueError, match="only contiguous arrays"):
        ArrayTable(np.zeros((4, 4))[:, :2])
    with pytest.raises(ValueError, match="up to four dimensions"):
        ArrayTable(np.zeros((1, 1, 1, 1, 1)))


def test_a_table_keeps_its_arrays_alive_and_cannot_be_copied() -> None:
    table = ArrayTable(np.full(100_000, 7.0))
    np.testing.assert_array_equal(array_table.floats_1(table.rows, 0), 7.0)
    with pytest.raises(TypeError, match="cannot be copied"):
        copy.deepcopy(table)
