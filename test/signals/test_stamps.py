# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Delays of the streams, and which stream's stamps are ahead or behind."""

import pytest

from adk_ros.signals.channels import Source
from adk_ros.signals.stamps import StampMonitor, StreamStamps, leads

IMU, ODOMETRY, COMMAND = Source.IMU, Source.ODOMETRY, Source.COMMAND
MS = 1_000_000


def steady(delay_s: float) -> StreamStamps:
    return StreamStamps(delay_s, is_stuck=False, is_erratic=False)


def seen(monitor: StampMonitor, source: Source, count: int, delay_ms: float, step_ms: int) -> None:
    for number in range(count):
        arrival_ns = number * step_ms * MS
        monitor.see(source, arrival_ns - round(delay_ms * MS), arrival_ns)


def test_delay_is_the_median_of_the_last_second() -> None:
    monitor = StampMonitor()
    seen(monitor, ODOMETRY, 100, 80.0, 20)
    for number in range(100, 150):
        wrong_ns = 10**18 if number == 120 else 0
        monitor.see(ODOMETRY, number * 20 * MS - 3 * MS + wrong_ns, number * 20 * MS)
    (item,) = monitor.statistics(150 * 20 * MS).values()
    assert item.delay_s == pytest.approx(0.003)
    assert item.is_steady


def test_slow_streams_count_by_their_last_five_messages() -> None:
    monitor = StampMonitor()
    seen(monitor, COMMAND, 4, 7.0, 2000)
    assert not monitor.statistics(9_000 * MS)[COMMAND].is_stuck
    assert monitor.statistics(9_000 * MS)[COMMAND].delay_s == pytest.approx(0.007)


def test_equal_and_jumping_stamps() -> None:
    monitor = StampMonitor()
    for number in range(20):
        monitor.see(IMU, 5, number * MS)
        # Two publishers of different clocks.
        monitor.see(ODOMETRY, number * MS + (number % 2) * 10**12, number * MS)
        # Each message twice.
        monitor.see(COMMAND, number // 2 * MS, number * MS)
    found = monitor.statistics(20 * MS)
    assert (found[IMU].is_stuck, found[IMU].is_steady) == (True, False)
    assert (found[ODOMETRY].is_erratic, found[ODOMETRY].is_steady) == (True, False)
    assert found[COMMAND].is_steady
    assert Source.STEERING not in found


@pytest.mark.parametrize("offset_s", [None, 0.0, 1e9])
def test_the_majority_is_right(offset_s: float | None) -> None:
    streams = {IMU: steady(0.001), ODOMETRY: steady(0.01), COMMAND: steady(-0.1)}
    found = leads(streams, 0.075, offset_s)
    assert found[COMMAND] == pytest.approx(0.1055)
    assert found[IMU] == pytest.approx(0.0045)
    assert found[ODOMETRY] == pytest.approx(-0.0045)


def test_of_two_streams_the_clock_knows_which_is_right() -> None:
    streams = {ODOMETRY: steady(-5.0), COMMAND: steady(-5.5)}
    assert leads(streams, 0.075, None) == {}
    assert leads(streams, 0.075, 5.001) == {ODOMETRY: 0.0, COMMAND: 0.5}
    assert leads(streams, 0.075, 500.0) == {}


def test_unsteady_streams_are_left_out() -> None:
    stuck = StreamStamps(9.0, is_stuck=True, is_erratic=False)
    assert leads({IMU: stuck, ODOMETRY: steady(0.0)}, 0.075, 0.001) == {ODOMETRY: 0.0}
    assert leads({}, 0.075, 0.0) == {}


def test_fast_and_slow_streams_are_compared_over_the_same_time() -> None:
    """A bag played at twice its speed: each delay falls by a second in a second."""
    monitor = StampMonitor()
    for source, step_ms in ((IMU, 1), (ODOMETRY, 20)):
        for number in range(3000 // step_ms):
            arrival_ns = number * step_ms * MS
            monitor.see(source, 2 * arrival_ns, arrival_ns)
    found = monitor.statistics(3_000 * MS)
    assert found[IMU].delay_s == pytest.approx(found[ODOMETRY].delay_s, abs=0.03)


def test_a_single_stamp_of_another_century_is_no_delay() -> None:
    monitor = StampMonitor()
    for k in range(20):
        stamp_ns = k * 100_000_000 if k != 15 else 70 * 365 * 86_400 * 10**9
        monitor.see(Source.ODOMETRY, stamp_ns, k * 100_000_000 + 80_000_000)
    assert monitor.least_delay_ns(20 * 100_000_000) == 80_000_000
