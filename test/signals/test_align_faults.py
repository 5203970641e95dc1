# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Alignment under faults: timeouts, wrong stamps, clock jumps, frozen sensors, duplicates."""

import math
from collections.abc import Iterable

import numpy as np
import pytest
from helpers.signals import (
    START_NS,
    assert_grid,
    drive,
    errors,
    in_order,
    same,
    seconds,
    without,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from adk_ros.signals.align import Aligner, _carried_on, align_samples
from adk_ros.signals.channels import STANDARD_SOURCES, TICK_NS, Flag, Reading, Sample, Source

S = 1_000_000_000
STALE = {
    Source.IMU: Flag.IMU_STALE, Source.ODOMETRY: Flag.ODOMETRY_STALE,
    Source.COMMAND: Flag.COMMAND_STALE,
}  # fmt: skip


def shifted(readings: Iterable[Reading], by_s: float) -> list[Reading]:
    return [r._replace(stamp_ns=r.stamp_ns + round(by_s * S)) for r in readings]


def between(samples: Iterable[Sample], after_s: float, until_s: float) -> list[Sample]:
    return [s for s in samples if after_s <= seconds(s) < until_s]


def flags(samples: Iterable[Sample]) -> set[int]:
    return {s.flags for s in samples}


@pytest.mark.parametrize("source", STANDARD_SOURCES)
def test_one_topic_stops_for_two_seconds(source: Source) -> None:
    samples = align_samples(without(in_order(drive(8.0)), source, 3.0, 5.0))
    assert_grid(samples)
    assert flags(between(samples, 0.5, 3.02)) == {0}
    affected = between(samples, 3.1, 3.45 if source is Source.IMU else 5.0)
    assert all(s.flags & STALE[source] and not s.learnable for s in affected)
    if source is Source.IMU:
        # Then it counts as a vehicle without one.
        assert flags(between(samples, 3.55, 5.0)) == {Flag.NO_IMU}
        affected = between(samples, 3.1, 5.0)
    assert flags(between(samples, 5.1, 7.9)) == {0}
    if source is Source.IMU:
        # What it says first is not a continuation of odometry's yaw rate.
        assert Flag.IMU_STALE in flags(between(samples, 4.98, 5.1))
    assert np.abs(errors(between(samples, 5.1, 7.9))).max() < 1e-3
    if source is Source.ODOMETRY:
        # Half a second from the accelerometer only, then no state.
        assert np.abs(errors(between(samples, 3.1, 3.45))).max() < 0.06
        assert all(s.flags & Flag.COASTING for s in between(samples, 3.55, 5.0))
        assert all(math.isnan(v) for s in between(samples, 3.55, 5.0) for v in s.x)
    else:
        assert np.abs(errors(affected)).max() < 0.02
    if source is Source.IMU:
        assert all(math.isnan(s.a[0]) for s in affected)
    if source is Source.COMMAND:
        assert len({s.u for s in affected}) == 1


def test_the_force_is_integrated_until_a_longer_timeout() -> None:
    """The first half second after odometry, in which the car brakes, must count to the end."""
    readings = without(in_order(drive(6.0)), Source.ODOMETRY, 3.0, 99.0)
    aligner = Aligner(odometry_timeout_s=2.0)
    samples = align_samples(readings, aligner)
    found = between(samples, 4.5, 4.95)
    assert not any(s.flags & Flag.COASTING for s in found)
    expected = align_samples(in_order(drive(6.0)))
    by_stamp = {s.stamp_ns: s.x for s in expected}
    off = np.array([np.subtract(s.x, by_stamp[s.stamp_ns]) for s in found])
    assert np.abs(off[:, 0]).max() < 0.25


def test_a_velocity_is_carried_on_exactly_at_constant_force_and_yaw_rate() -> None:
    """Braking at 8 m/s^2 in a turn: one step of Euler's is off by 5 m/s in v_y after 2 s."""
    force, v = (-8.0, 3.0, 0.3), np.array([30.0, -0.5])
    for _ in range(20000):
        d = np.array([force[0] + force[2] * v[1], force[1] - force[2] * v[0]])
        middle = v + 0.5e-4 * d
        v = v + 1e-4 * np.array([force[0] + force[2] * middle[1], force[1] - force[2] * middle[0]])
    assert _carried_on(30.0, -0.5, force, 2.0) == pytest.approx(v, abs=1e-5)
    straight = _carried_on(30.0, 0.0, (-8.0, 0.0, 1e-9), 2.0)
    assert straight == pytest.approx((14.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("source", STANDARD_SOURCES)
def test_one_topic_stops_for_good(source: Source) -> None:
    samples = align_samples(without(in_order(drive(30.0)), source, 3.0, 99.0))
    assert_grid(samples)
    assert seconds(samples[-1]) > 29.9
    if source is Source.IMU:
        later = between(samples, 3.55, 30.0)
        assert all(s.flags == Flag.NO_IMU and s.learnable for s in later)
        return
    assert all(s.flags & STALE[source] for s in between(samples, 3.1, 30.0))
    assert any(s.flags & Flag.COASTING for s in samples) == (source is Source.ODOMETRY)


@pytest.mark.parametrize("left", STANDARD_SOURCES)
def test_two_topics_stop(left: Source) -> None:
    readings: list[Reading] = in_order(drive(9.0))
    for source in STANDARD_SOURCES:
        if source is not left:
            readings = list(without(readings, source, 3.0, 6.0))
    samples = align_samples(readings)
    assert_grid(samples)
    for source in STANDARD_SOURCES:
        stops = STALE[source] | (Flag.NO_IMU if source is Source.IMU else 0)
        stale = [bool(s.flags & stops) for s in between(samples, 3.1, 6.0)]
        assert set(stale) == {source is not left}
    assert flags(between(samples, 6.1, 8.9)) == {0}


def test_short_gap_of_all_topics_gives_flagged_samples() -> None:
    readings = in_order(drive(8.0))
    for source in STANDARD_SOURCES:
        readings = list(without(readings, source, 3.0, 3.8))
    samples = align_samples(readings)
    assert_grid(samples)
    assert not any(s.learnable for s in between(samples, 3.1, 3.8))
    assert flags(between(samples, 3.9, 7.9)) == {0}


def test_long_gap_of_all_topics_causes_a_restart() -> None:
    readings = in_order(drive(12.0))
    for source in STANDARD_SOURCES:
        readings = list(without(readings, source, 3.0, 6.0))
    aligner = Aligner()
    samples = [s for r in readings for s in aligner.push(r)]
    restarts = [s for s in samples if s.flags & Flag.RESTART]
    assert [round(seconds(s), 1) for s in restarts] == [0.0, 6.0]
    assert not between(samples, 3.1, 6.0)
    assert_grid(between(samples, 6.0, 12.0))
    assert aligner.counts == {"clock jump": 1}


def test_stopped_stream_is_waited_for_only_once() -> None:
    """Samples are late while it is waited for, and on time afterwards."""
    aligner, waits = Aligner(), {}
    for reading in without(in_order(drive(6.0)), Source.ODOMETRY, 3.0, 99.0):
        for sample in aligner.push(reading):
            waits[seconds(sample)] = (reading.stamp_ns - sample.stamp_ns) * 1e-9
    assert max(waits.values()) <= 0.056
    assert max(wait for at, wait in waits.items() if at < 2.95) <= 0.025
    assert max(wait for at, wait in waits.items() if at > 3.2) <= 0.025
    assert sum(wait > 0.026 for wait in waits.values()) <= 4


@pytest.mark.parametrize("source", STANDARD_SOURCES)
def test_duplicates(source: Source) -> None:
    readings = in_order(drive(4.0, noise=0.01))
    doubled = []
    for reading in readings:
        doubled.append(reading)
        if reading.source is source:
            repeated = tuple(-9.0 * value for value in reading.values)
            doubled += [reading, reading._replace(values=repeated)]
    aligner = Aligner()
    samples = [s for r in doubled for s in aligner.push(r)]
    plain = align_samples(readings)
    assert len(plain) == len(samples)
    assert all(map(same, plain, samples))
    assert aligner.counts == {"duplicate": len(doubled) - len(readings)}


@pytest.mark.parametrize("hours", [1, -1, 24 * 365 * 10])
def test_implausible_stamps(hours: int) -> None:
    """Every fiftieth reading has a wrong stamp: it does not affect the samples."""
    readings = in_order(drive(6.0))
    disturbed = [
        *(shifted([r], 3600.0 * hours)[0] if k % 50 == 49 else r for k, r in enumerate(readings))
    ]  # fmt: skip
    aligner = Aligner()
    samples = [s for r in disturbed for s in aligner.push(r)]
    expected = align_samples([r for k, r in enumerate(readings) if k % 50 != 49])
    assert len(expected) == len(samples)
    assert all(map(same, expected, samples))
    wrong = len(readings) // 50
    assert aligner.counts == {"stray stamp": wrong - (len(readings) % 50 == 0)}


@pytest.mark.parametrize("loops", [1, 4])
def test_looping_bag(loops: int) -> None:
    """The clock jumps back: the state restarts without influence of the previous loop."""
    once = in_order(drive(5.0, noise=0.01))
    aligner = Aligner()
    plain = [s for r in once for s in aligner.push(r)]
    for _ in range(loops):
        samples = [s for r in once for s in aligner.push(r)]
        assert samples[0].flags & Flag.RESTART
        assert not any(s.flags & Flag.RESTART for s in samples[1:])
        assert_grid(samples)
        # The three readings that confirm the jump are not lost.
        assert all(map(same, samples, plain))
        assert len(samples) == len(plain)
    assert aligner.counts == {"clock jump": loops}


@pytest.mark.parametrize("by_s", [3.0, 3600.0, 1e9])
def test_clock_jumps_ahead(by_s: float) -> None:
    aligner = Aligner()
    readings = in_order(drive(3.0))
    samples = [s for r in readings for s in aligner.push(r)]
    more = in_order(drive(3.0, begin_s=3.0))
    after = [s for r in shifted(more, by_s) for s in aligner.push(r)]
    assert after[0].flags & Flag.RESTART
    assert_grid(after)
    assert len(after) > 110
    assert flags(after[3:]) == {0}
    assert samples[-1].stamp_ns < after[0].stamp_ns
    assert aligner.counts == {"clock jump": 1}


@pytest.mark.parametrize("by_s", [-0.4, 0.4])
def test_clock_correction_below_a_second(by_s: float) -> None:
    """The samples stay consecutive, stale ones are flagged, and the state recovers."""
    readings = [*in_order(drive(4.0)), *shifted(in_order(drive(6.0, begin_s=4.0)), by_s)]
    samples = align_samples(readings)
    assert_grid(samples)
    assert flags(between(samples, 5.5, 9.0)) == {0}
    at = [s._replace(stamp_ns=s.stamp_ns - round(by_s * S)) for s in between(samples, 5.5, 9.0)]
    assert np.abs(errors(at)).max() < 1e-3


@pytest.mark.parametrize("source", STANDARD_SOURCES)
def test_single_stamp_half_a_second_ahead(source: Source) -> None:
    """Too close to count as implausible. Samples up to it are flagged."""
    readings = in_order(drive(8.0))
    index = next(
        k for k, r in enumerate(readings) if r.source is source and r.stamp_ns > START_NS + 3 * S
    )
    readings[index] = shifted([readings[index]], 0.5)[0]
    aligner = Aligner()
    samples = [s for r in readings for s in aligner.push(r)]
    assert_grid(samples)
    assert flags(between(samples, 4.0, 7.9)) == {0}
    assert np.abs(errors(between(samples, 4.0, 7.9))).max() < 0.02
    assert aligner.counts["late"] > 20
    # The error is at most the change within half a second, and only while the reading is used.
    wrong = np.abs(errors([s for s in between(samples, 0.5, 4.0) if s.learnable]))
    assert wrong.max() < 0.7
    assert (wrong.max(axis=1) > 0.02).sum() <= 3


def test_late_readings_are_counted_and_used_for_later_samples() -> None:
    readings = in_order(drive(5.0))
    delayed = [r for r in readings if r.source is Source.ODOMETRY]
    others = [r for r in readings if r.source is not Source.ODOMETRY]
    events = sorted(
        [(r.stamp_ns, r) for r in others] + [(r.stamp_ns + 120_000_000, r) for r in delayed],
        key=lambda event: event[0],
    )
    aligner = Aligner()
    samples = [s for _, r in events for s in aligner.push(r)]
    assert_grid(samples)
    assert aligner.counts["late"] > 200
    assert "duplicate" not in aligner.counts
    # The state is dead-reckoned over the part of the delay beyond the wait.
    assert np.abs(errors(between(samples, 1.0, 4.9))).max() < 0.02


def test_out_of_order_within_a_stream() -> None:
    readings = in_order(drive(5.0))
    swapped = list(readings)
    imu = [k for k, r in enumerate(readings) if r.source is Source.IMU]
    for one, two in zip(imu[10::7], imu[11::7], strict=False):
        swapped[one], swapped[two] = swapped[two], swapped[one]
    aligner = Aligner()
    samples = [s for r in swapped for s in aligner.push(r)]
    assert_grid(samples)
    assert aligner.counts["out of order"] == len(imu[11::7])
    assert flags(samples[1:]) == {0}
    assert np.abs(errors(between(samples, 0.5, 5.0))).max() < 1e-3


def freeze(
    readings: list[Reading], source: Source, after_s: float, until_s: float
) -> list[Reading]:
    """Return the readings with `source` repeating its values in a time interval."""
    low, high = START_NS + after_s * S, START_NS + until_s * S
    result: list[Reading] = []
    repeated: tuple[float, ...] | None = None
    for reading in readings:
        frozen = reading.source is source and low <= reading.stamp_ns < high
        repeated = (repeated or reading.values) if frozen else repeated
        result.append(reading._replace(values=repeated) if frozen and repeated else reading)
    return result


def test_frozen_odometry() -> None:
    samples = align_samples(freeze(in_order(drive(9.0)), Source.ODOMETRY, 3.0, 6.0))
    assert_grid(samples)
    assert flags(between(samples, 0.5, 3.9)) == {0}
    frozen = between(samples, 4.1, 6.0)
    assert flags(frozen) == {int(Flag.FROZEN | Flag.COASTING)}
    assert all(math.isnan(s.x[0]) for s in frozen)
    assert flags(between(samples, 6.05, 8.9)) == {0}


def test_frozen_imu() -> None:
    """The state then comes from odometry only."""
    samples = align_samples(freeze(in_order(drive(9.0)), Source.IMU, 3.0, 6.0))
    assert_grid(samples)
    frozen = between(samples, 4.1, 6.0)
    assert flags(frozen) == {int(Flag.FROZEN)}
    assert not any(s.learnable for s in frozen)
    assert np.abs(errors(frozen)).max() < 1e-3
    assert all(math.isnan(s.a[0]) for s in frozen)
    assert flags(between(samples, 6.05, 8.9)) == {0}


def test_constant_command_is_not_frozen() -> None:
    samples = align_samples(freeze(in_order(drive(9.0)), Source.COMMAND, 3.0, 9.0))
    assert flags(samples[1:]) == {0}


def test_standing_vehicle_is_not_frozen() -> None:
    still = [r._replace(values=(0.0,) * len(r.values)) for r in in_order(drive(6.0))]
    samples = align_samples(still)
    assert flags(samples[1:]) == {0}
    assert all(s.x == (0.0, 0.0, 0.0) for s in samples)


def test_frozen_check_can_be_switched_off() -> None:
    readings = freeze(in_order(drive(6.0)), Source.ODOMETRY, 2.0, 6.0)
    aligner = Aligner(frozen_after_s=0.0)
    assert flags([s for r in readings for s in aligner.push(r)][1:]) == {0}


def test_memory_is_bounded_without_commands() -> None:
    aligner = Aligner()
    for reading in in_order(drive(60.0, 100, 20, 0)):
        assert aligner.push(reading) == []
    assert max(len(stream.stamps) for stream in aligner.streams) <= 102


def test_memory_is_bounded() -> None:
    aligner = Aligner()
    for reading in in_order(drive(30.0, 200, 50, 40)):
        aligner.push(reading)
    assert max(len(stream.stamps) for stream in aligner.streams) <= 202


FAULTS = st.lists(
    st.tuples(
        st.integers(0, 500),
        st.sampled_from(["drop", "twice", "ahead", "behind", "swap", "hour", "loop", "silence"]),
    ),
    max_size=25,
)


@settings(max_examples=60)
@given(FAULTS)
def test_random_faults_keep_the_samples_consistent(faults: list[tuple[int, str]]) -> None:
    """Time goes back only at a RESTART; states are finite or flagged; the state recovers."""
    readings = in_order(drive(2.0))
    for position, kind in faults:
        index = min(position, len(readings) - 2)
        reading = readings[index]
        if kind == "drop":
            del readings[index]
        elif kind == "twice":
            readings.insert(index, reading)
        elif kind in ("ahead", "behind", "hour"):
            by_s = {"ahead": 0.3, "behind": -0.3, "hour": 3600.0}[kind]
            readings[index] = shifted([reading], by_s)[0]
        elif kind == "swap":
            readings[index], readings[index + 1] = readings[index + 1], reading
        elif kind == "loop":
            readings = [*readings[:index], *readings[: max(index, 50)]]
        else:
            readings = [*readings[:index], *readings[index + 60 :]]
            readings += in_order(drive(0.5, begin_s=2.0))
        readings = readings[:3000]
    aligner = Aligner()
    last: Sample | None = None
    valid = shifted(in_order(drive(4.0)), 50.0)
    for reading in [*readings, *valid]:
        for sample in aligner.push(reading):
            assert sample.stamp_ns % TICK_NS == 0
            if last is not None and not sample.flags & Flag.RESTART:
                assert sample.stamp_ns == last.stamp_ns + TICK_NS
            finite = [math.isfinite(value) for value in sample.x]
            assert all(finite) or (not any(finite) and sample.flags & Flag.COASTING)
            assert all(math.isfinite(value) for value in sample.u)
            last = sample
    assert last is not None
    assert last.flags == 0
    assert last.stamp_ns > valid[-1].stamp_ns - 100_000_000
