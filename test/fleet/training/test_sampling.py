# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which blocks train, validate and test, and in which windows they are drawn."""

from __future__ import annotations

from collections import Counter

import pytest

from adk_ros.errors import UsageError
from adk_ros.fleet.training.sampling import BlockWindows, FleetBlock, split_vehicles


def blocks(condition: str, number: int, seconds: float = 30.0) -> list[FleetBlock]:
    return [
        FleetBlock(f"r{i // 10}", "car", f"{condition}{i // 10}", i, i + 1, condition, seconds)
        for i in range(number)
    ]


def drawn(windows: BlockWindows, number: int) -> Counter[str]:
    return Counter(block.condition for block in windows.window(number))


@pytest.mark.parametrize(("number", "sizes"), [(3, (1, 1, 1)), (12, (9, 1, 2)), (40, (28, 4, 8))])
def test_a_tenth_validates_and_a_fifth_tests(number, sizes) -> None:
    names = [f"car {i}" for i in range(number)]
    split = split_vehicles(names)
    assert (len(split.train), len(split.validation), len(split.test)) == sizes
    assert sorted(split.train + split.validation + split.test) == sorted(names)
    assert split == split_vehicles(reversed(names))
    assert any(split_vehicles(names, seed) != split for seed in (1, 2, 3))


def test_given_vehicles_are_held_out() -> None:
    split = split_vehicles("abcde", validation=["c"], test=["a", "b"])
    assert split.validation == ("c",)
    assert split.test == ("a", "b")
    assert split.train == ("d", "e")


@pytest.mark.parametrize(
    ("vehicles", "given", "said"),
    [
        ("ab", {}, "2 vehicles have usable recordings"),
        ("", {}, "0 vehicles have usable recordings \\(none\\)"),
        ("a", {}, "1 vehicle has usable recordings \\(a\\)"),
        ("abc", {"test": ["z"]}, "'z' has no usable recording; there are a, b, c"),
        ("abc", {"test": ["a"], "validation": ["a"]}, "'a' cannot both"),
        ("abc", {"test": ["a", "b"], "validation": ["c"]}, "no vehicle is left to train"),
    ],
)
def test_an_impossible_split_is_refused(vehicles, given, said) -> None:
    with pytest.raises(UsageError, match=said):
        split_vehicles(vehicles, **given)


def test_a_rare_condition_is_in_every_window() -> None:
    windows = BlockWindows(blocks("town", 380) + blocks("wet", 20), 3000.0)
    assert windows.count == 4
    for number in range(windows.count):
        assert drawn(windows, number) == {"town": 80, "wet": 20}
    assert windows.shares() == {"town": (0.95, 0.8), "wet": (0.05, 0.2)}


def test_equal_shares_where_there_is_enough() -> None:
    windows = BlockWindows(blocks("town", 600) + blocks("wet", 200), 3000.0)
    assert drawn(windows, 0) == {"town": 50, "wet": 50}


def test_all_blocks_are_drawn_once_before_one_is_drawn_again() -> None:
    every = blocks("town", 400)
    windows = BlockWindows(every, 3000.0)
    seen = Counter(block for number in range(windows.count) for block in windows.window(number))
    assert set(seen) == set(every)
    assert set(seen.values()) == {1}


@pytest.mark.parametrize(("count", "seconds"), [(1075, 3600.0), (101, 380.0), (5, 90.0)])
def test_windows_that_are_no_multiple_of_a_block_draw_each_once(count, seconds) -> None:
    every = blocks("town", count)
    windows = BlockWindows(every, seconds)
    seen = Counter(block for number in range(windows.count) for block in windows.window(number))
    assert set(seen) == set(every)
    assert set(seen.values()) == {1}


def test_unbalanced_windows_have_the_shares_of_the_data() -> None:
    windows = BlockWindows(blocks("town", 900) + blocks("wet", 100), 15000.0, balanced=False)
    shares = [drawn(windows, k)["wet"] / 500 for k in range(windows.count)]
    assert sum(shares) / len(shares) == pytest.approx(0.1, abs=0.01)


def test_a_window_is_bounded_however_large_the_fleet() -> None:
    for number in (50, 500, 5000):
        every = blocks("town", number) + blocks("wet", number // 10) + blocks("ice", 1)
        windows = BlockWindows(every, 3600.0)
        for k in (0, 1, windows.count - 1):
            assert sum(block.seconds for block in windows.window(k)) <= 3600.0 + 3 * 15.0


def test_a_window_is_reproducible_and_depends_on_the_seed() -> None:
    every = blocks("town", 400)
    one, same, other = (BlockWindows(every, 3000.0, seed) for seed in (0, 0, 1))
    assert one.window(2) == same.window(2)
    assert one.key == same.key
    assert one.window(2) != other.window(2)
    assert one.key != other.key
    assert one.window(0) != one.window(1)


def test_neighbouring_blocks_are_read_together() -> None:
    window = BlockWindows(blocks("town", 400), 3000.0).window(0)
    assert window == sorted(window, key=lambda block: (block.shard, block.start))


def test_conditions_with_less_than_a_block_in_a_window_take_turns() -> None:
    """Of 380 conditions with five blocks each, a window of an hour has 120 blocks."""
    every = [block for i in range(380) for block in blocks(f"c{i}", 5)]
    windows = BlockWindows(every, 3600.0)
    sizes = [len(windows.window(number)) for number in range(windows.count)]
    assert max(sizes) <= 130
    seen = Counter(block for number in range(windows.count) for block in windows.window(number))
    assert max(seen.values()) == 1
    assert len(seen) > 0.95 * len(every)


def test_a_window_of_less_than_half_a_block_has_one() -> None:
    windows = BlockWindows(blocks("town", 5), 10.0)
    assert all(len(windows.window(number)) == 1 for number in range(windows.count))
