# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Time stamps: single implausible ones, clock jumps, two alternating clocks."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adk_ros.signals.channels import Reading, Source
from adk_ros.signals.clock import ClockGuard, StampVerdict

S = 1_000_000_000
ACCEPT, HOLD, JUMP = StampVerdict.ACCEPT, StampVerdict.HOLD, StampVerdict.JUMP


def at(time_s: float) -> Reading:
    return Reading(Source.ODOMETRY, round(time_s * S), (0.0, 0.0, 0.0))


def verdicts(guard: ClockGuard, *times_s: float) -> list[tuple[StampVerdict, int]]:
    results = [guard.check_stamp(at(time_s)) for time_s in times_s]
    return [(verdict, len(resolved)) for verdict, resolved in results]


def test_ordinary_readings() -> None:
    guard = ClockGuard()
    assert guard.newest_ns is None
    assert verdicts(guard, 100.0, 100.01, 100.9, 100.5) == [(ACCEPT, 0)] * 4
    assert guard.newest_ns == round(100.9 * S)


@pytest.mark.parametrize("outlier", [4000.0, 101.01, 98.9, 1e-9, 9.2e9])
def test_implausible_stamp_is_counted_when_time_continues(outlier: float) -> None:
    guard = ClockGuard()
    assert verdicts(guard, 100.0, outlier, 100.1) == [(ACCEPT, 0), (HOLD, 0), (ACCEPT, 1)]
    assert guard.newest_ns == round(100.1 * S)
    assert guard.pending == []


@pytest.mark.parametrize("new", [3.0, 98.5, 101.5, 1e6])
def test_three_consistent_stamps_are_a_jump(new: float) -> None:
    guard = ClockGuard()
    assert verdicts(guard, 100.0, new, new + 0.01) == [(ACCEPT, 0), (HOLD, 0), (HOLD, 0)]
    verdict, resolved = guard.check_stamp(at(new + 0.005))
    assert verdict is JUMP
    assert [r.stamp_ns for r in resolved] == [
        at(t).stamp_ns for t in (new, new + 0.01, new + 0.005)
    ]
    assert guard.newest_ns == at(new + 0.01).stamp_ns
    assert verdicts(guard, new + 0.02) == [(ACCEPT, 0)]


def test_inconsistent_stamps_are_no_jump() -> None:
    guard = ClockGuard()
    assert verdicts(guard, 100.0, 500.0, 900.0, 3.0, 700.0) == [
        (ACCEPT, 0), (HOLD, 0), (HOLD, 1), (HOLD, 1), (HOLD, 1)
    ]  # fmt: skip
    assert verdicts(guard, 100.1) == [(ACCEPT, 1)]


def test_first_of_two_alternating_clocks_is_used() -> None:
    guard = ClockGuard()
    found = verdicts(guard, *(t for k in range(50) for t in (100 + 0.01 * k, 9000 + 0.01 * k)))
    assert [verdict for verdict, _ in found] == [ACCEPT, HOLD] * 50
    assert sum(count for _, count in found) == 49


def test_second_clock_is_used_when_the_first_one_ends() -> None:
    guard = ClockGuard()
    verdicts(guard, 100.0, 9000.0, 100.01)
    assert [v for v, _ in verdicts(guard, 9000.02, 9000.03, 9000.04)] == [HOLD, HOLD, JUMP]


def test_clock_that_jumps_repeatedly() -> None:
    guard = ClockGuard()
    verdicts(guard, 100.0)
    for begin in (50.0, 100.0, 50.0, 7.0):
        assert [v for v, _ in verdicts(guard, begin, begin + 0.1, begin + 0.2)] == [
            HOLD, HOLD, JUMP
        ]  # fmt: skip


def test_implausible_first_stamp_is_corrected() -> None:
    guard = ClockGuard()
    assert [v for v, _ in verdicts(guard, 9e6, 100.0, 100.01, 100.02, 100.03)] == [
        ACCEPT, HOLD, HOLD, JUMP, ACCEPT
    ]  # fmt: skip


def imu(time_s: float) -> Reading:
    return at(time_s)._replace(source=Source.IMU)


def test_an_imu_of_another_time_is_ignored_at_any_rate() -> None:
    """Ten IMU readings between two of odometry, from the first one on and later."""
    guard = ClockGuard()
    found = []
    for k in range(30):
        for i in range(10):
            found.append(guard.check_stamp(imu(9e6 + 0.02 * k + 0.002 * i))[0])
        found.append(guard.check_stamp(at(100.0 + 0.02 * k))[0])
    assert found.count(JUMP) == 1
    assert found.index(JUMP) == 32
    assert found[33:] == ([HOLD] * 10 + [ACCEPT]) * 27
    assert guard.newest_ns == at(100.58).stamp_ns


def test_an_imu_that_stays_behind_does_not_refute_a_jump() -> None:
    guard = ClockGuard()
    verdicts(guard, 100.0)
    found = []
    for k in range(3):
        found += [guard.check_stamp(imu(100.01 + 0.01 * k)), guard.check_stamp(at(5.0 + k / 100))]
    assert [verdict for verdict, _ in found] == [ACCEPT, HOLD, ACCEPT, HOLD, ACCEPT, JUMP]
    assert guard.newest_ns == at(5.02).stamp_ns


def test_an_imu_jumps_together_with_odometry() -> None:
    guard = ClockGuard()
    verdicts(guard, 100.0)
    assert guard.check_stamp(imu(5.0))[0] is HOLD
    assert guard.check_stamp(imu(5.01))[0] is HOLD
    verdict, resolved = guard.check_stamp(at(5.02))
    assert (verdict, len(resolved)) == (JUMP, 3)


def test_an_imu_alone_keeps_a_bounded_number_waiting() -> None:
    guard = ClockGuard()
    verdicts(guard, 100.0)
    counted = sum(len(guard.check_stamp(imu(5.0 + k / 1000))[1]) for k in range(500))
    assert counted + len(guard.pending) == 500
    assert len(guard.pending) == 100


def test_reset_accepts_the_next_stamp() -> None:
    guard = ClockGuard()
    verdicts(guard, 100.0, 5.0)
    guard.reset()
    assert guard.newest_ns is None
    assert guard.pending == []
    assert verdicts(guard, 3.0) == [(ACCEPT, 0)]


def test_jump_s_is_the_limit() -> None:
    guard = ClockGuard(jump_s=0.2)
    assert verdicts(guard, 100.0, 100.2, 100.41)[1:] == [(ACCEPT, 0), (HOLD, 0)]


@given(st.lists(st.tuples(st.sampled_from(Source), st.integers(1, 2**62)), max_size=60))
def test_no_reading_is_lost_or_counted_twice(items: list[tuple[Source, int]]) -> None:
    """Each reading is accepted, returned exactly once, or pending."""
    guard = ClockGuard()
    accepted = returned = 0
    for number, (source, stamp_ns) in enumerate(items, start=1):
        verdict, resolved = guard.check_stamp(Reading(source, stamp_ns, (0.0, 0.0, 0.0)))
        accepted += verdict is ACCEPT
        returned += len(resolved)
        assert accepted + returned + len(guard.pending) == number
        others = [r for r in guard.pending if r.source is not Source.IMU]
        assert len(others) < 3
