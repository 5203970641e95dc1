# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Readings with wrong stamps: what the watch gets of them, and when it begins anew."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import takewhile

import pytest
from helpers.watch import changing_drive, surrogate

from adk_ros.bench.mismatch.watch_drives import readings_of
from adk_ros.mismatch.watch.stamp_filter import StampFilter
from adk_ros.mismatch.watch.watch import Watch
from adk_ros.signals.channels import Reading, Source

START_NS = 1_760_000_000_000_000_000
PERIODS_S = {Source.IMU: 0.01, Source.ODOMETRY: 0.02, Source.COMMAND: 0.05}


def stream(*spans_s: tuple[float, float], ahead_s: float = 0.0) -> list[Reading]:
    """Readings of all sources in spans of time, in the order of their stamps."""
    times = [
        (source, begin_s + i * period_s + ahead_s)
        for begin_s, end_s in spans_s
        for source, period_s in PERIODS_S.items()
        for i in range(max(round((end_s - begin_s) / period_s), 1))
    ]
    found = [Reading(s, START_NS + round(1e9 * at_s), (1.0, 0.0, 0.0)) for s, at_s in times]
    return sorted(found, key=lambda reading: reading.stamp_ns)


def passed(readings: Iterable[Reading]) -> tuple[list[Reading], int, StampFilter[int]]:
    """Return the readings since the last new time, the number of new times, and the filter."""
    stamps: StampFilter[int] = StampFilter()
    taken: list[Reading] = []
    restarts = 0
    for number, reading in enumerate(readings):
        is_new_time, admitted = stamps.admit(reading, number)
        if is_new_time:
            restarts += 1
            taken = []
        taken += [kept for kept, _ in admitted]
    return taken, restarts, stamps


def delayed(readings: list[Reading], by_s: Callable[[Reading], float]) -> list[Reading]:
    """The same readings in the order in which they arrive."""
    return sorted(readings, key=lambda reading: reading.stamp_ns + 1e9 * by_s(reading))


def late_odometry(reading: Reading) -> float:
    return 1.9 if reading.source is Source.ODOMETRY else 0.0


def burst(reading: Reading) -> float:
    """Odometry between 4 and 14 s arrives at once, at 14 s."""
    at_s = 1e-9 * (reading.stamp_ns - START_NS)
    return 14.0 - at_s if reading.source is Source.ODOMETRY and 4.0 < at_s < 14.0 else 0.0


@pytest.mark.parametrize(
    "readings",
    [
        [reading for reading, _ in readings_of(changing_drive(60.0))],
        delayed(stream((0.0, 10.0)), late_odometry),
        stream((0.0, 10.0), (24.0, 30.0)),
        stream((0.0, 2.0), (3600.0, 3602.0)),
    ],
)
def test_right_stamps_pass_unchanged_also_late_ones_and_those_after_a_pause(
    readings: list[Reading],
) -> None:
    taken, restarts, stamps = passed(readings)
    assert taken == readings
    assert restarts == 0
    assert not stamps.strays


@pytest.mark.parametrize("source", list(PERIODS_S))
@pytest.mark.parametrize("off_s", [3600.0, 4.0, -4.0, -3600.0])
@pytest.mark.parametrize("count", [1, 2])
def test_wrong_stamps_are_left_out(source: Source, off_s: float, count: int) -> None:
    readings = stream((0.0, 10.0))
    stamp_ns = readings[500].stamp_ns + round(1e9 * off_s)
    wrong = [Reading(source, stamp_ns + i, (9.0, 9.0, 9.0)) for i in range(count)]
    taken, restarts, stamps = passed([*readings[:500], *wrong, *readings[500:]])
    assert taken == readings
    assert restarts == 0
    assert stamps.strays == {source: count}


def test_a_wrong_stamp_changes_nothing_in_the_watch() -> None:
    drive = list(takewhile(lambda x: x[0].stamp_ns < 30e9, readings_of(changing_drive())))
    at = next(i for i, (reading, _) in enumerate(drive) if reading.stamp_ns > 5e9)
    watches = []
    for wrong in (None, *PERIODS_S):
        watch, stamps = Watch(surrogate(), lambda change: None), StampFilter[object]()
        given = list(drive)
        if wrong is not None:
            given.insert(at, (Reading(wrong, 3_600_000_000_000, (0.0, 0.0, 0.0)), None))
        for reading, pose in given:
            is_new_time, admitted = stamps.admit(reading, pose)
            assert not is_new_time
            for kept, _ in admitted:
                watch.push(kept, pose)
            watch.run()
        watches.append((watch.blocks_used, watch.blocks_skipped, watch.statistic, watch.state))
    assert watches[0][:2] == (5, 0)
    assert watches == [watches[0]] * 4


@pytest.mark.parametrize(
    "before",
    [
        stream((100.0, 110.0)),
        stream((0.0, 2.0), (100.0, 101.0)),
        stream((3600.0, 3600.01)),
        [Reading(Source.ODOMETRY, START_NS + 3_600_000_000_000, (0.0, 0.0, 0.0))],
        [Reading(Source.IMU, START_NS + 3_600_000_000_000, (0.0, 0.0, 0.0))],
    ],
)
def test_a_clock_that_jumps_back_is_a_new_time_of_which_nothing_is_lost(
    before: list[Reading],
) -> None:
    after = stream((0.0, 10.0))
    taken, restarts, _ = passed([*before, *after])
    assert restarts == 1
    assert taken == after


def test_a_clock_that_is_set_by_days_is_a_new_time() -> None:
    after = stream((0.0, 10.0))
    taken, restarts, _ = passed([*stream((0.0, 5.0), ahead_s=-1e-9 * START_NS), *after])
    assert restarts == 1
    assert taken == after


def test_a_stream_that_delivers_late_at_once_is_no_new_time() -> None:
    readings = stream((0.0, 20.0))
    taken, restarts, _ = passed(delayed(readings, burst))
    assert restarts == 0
    odometry = [x for x in readings if x.source is Source.ODOMETRY]
    assert [x for x in taken if x.source is Source.ODOMETRY] == odometry
    assert len(taken) > len(readings) - 20


def test_each_reading_keeps_its_item() -> None:
    stamps: StampFilter[int] = StampFilter()
    readings = [*stream((100.0, 101.0)), *stream((0.0, 1.0))]
    for number, reading in enumerate(readings):
        for kept, item in stamps.admit(reading, number)[1]:
            assert readings[item] is kept
    assert not stamps._held
