# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Alignment of undisturbed data: complete, causal, independent of arrival order, accurate."""

import math
from itertools import pairwise

import numpy as np
import pytest
from helpers.signals import (
    START_NS,
    arriving,
    assert_grid,
    command,
    drive,
    errors,
    force,
    in_order,
    same,
    seconds,
    state,
    steering,
    stream,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from adk_ros.signals.align import Aligner, align_samples
from adk_ros.signals.channels import STANDARD_SOURCES, TICK_NS, Flag, Reading, Sample, Source

RATES = [
    (200, 50, 40), (1000, 200, 200), (50, 10, 5), (50, 200, 200), (100, 30, 10), (1000, 10, 5),
    (400, 100, 33), (97, 41, 23), (0, 50, 40), (0, 10, 5), (0, 200, 200), (0, 20, 200),
]  # fmt: skip
NO_FAULT = int(Flag.NO_IMU)
MAX_WAIT_NS = 50_000_000


def after_start(rates: tuple[int, int, int], time_s: float) -> bool:
    """Return whether every stream has two readings, so that its period is known."""
    return time_s > 2.0 / min(rate for rate in rates if rate) + 0.05


@pytest.mark.parametrize("rates", RATES, ids=str)
def test_every_sample_is_present_and_valid(rates: tuple[int, int, int]) -> None:
    samples = align_samples(in_order(drive(8.0, *rates, jitter=0.08)))
    assert_grid(samples)
    assert seconds(samples[0]) < 1.0 / min(rate for rate in rates if rate) + 0.025
    assert seconds(samples[-1]) > 8.0 - 0.15 - 1.0 / max(rates[1:])
    assert samples[0].flags & Flag.RESTART
    for sample in samples:
        if after_start(rates, seconds(sample)):
            assert sample.flags == (0 if rates[0] else NO_FAULT)
            assert sample.learnable
            assert all(map(math.isfinite, sample.x + sample.u))
            assert math.isfinite(sample.a[0]) == bool(rates[0])


@pytest.mark.parametrize("rates", RATES, ids=str)
def test_state_is_more_accurate_than_the_last_reading(
    rates: tuple[int, int, int],
) -> None:
    readings = in_order(drive(12.0, *rates))
    samples = [s for s in align_samples(readings) if seconds(s) > 1.0]
    rms = np.sqrt(np.mean(errors(samples) ** 2, axis=0))
    odometry = [r for r in readings if r.source is Source.ODOMETRY]
    stamps = [r.stamp_ns for r in odometry]
    last = np.searchsorted(stamps, [s.stamp_ns for s in samples], side="right") - 1
    held = np.array([odometry[i].values for i in last]) - [state(seconds(s)) for s in samples]
    assert (rms < 0.2 * np.sqrt(np.mean(held**2, axis=0))).all()
    # Bounds: curvature of the slalom over one period of odometry, and of the gyro.
    period_s = 1.0 / rates[1]
    assert np.abs(errors(samples)[:, :2]).max() < (0.2 if rates[0] else 0.8) * period_s**2 + 1e-4
    gyro_s = max(1.0 / (rates[0] or rates[1]), 0.01)
    assert np.abs(errors(samples)[:, 2]).max() < 0.8 * gyro_s**2 + 1e-5


def test_fast_swerve_between_two_odometry_readings() -> None:
    """Force and yaw rate are averaged over the same interval."""
    samples = align_samples(in_order(drive(8.0, 400, 10, 40)))
    error = errors([s for s in samples if seconds(s) > 1.0])
    assert np.abs(error[:, 1]).max() < 2e-3


def test_noise_is_not_amplified() -> None:
    for rates in ((200, 50, 40), (0, 50, 40)):
        samples = align_samples(in_order(drive(20.0, *rates, noise=0.02)))
        deviation = errors([s for s in samples if seconds(s) > 1.0]).std(axis=0)
        assert (deviation < 1.35 * 0.02).all()
        if rates[0]:
            assert deviation[2] < 0.8 * 0.02


def test_command_is_held_and_force_is_averaged_over_the_tick() -> None:
    streams = drive(4.0, 200, 50, 30)
    samples = align_samples(in_order(streams))
    for sample in samples[40:]:
        held = [r for r in streams[2] if r.stamp_ns <= sample.stamp_ns][-1]
        assert sample.u == held.values
        low_ns, high_ns = sample.stamp_ns - TICK_NS, sample.stamp_ns
        within = [r.values for r in streams[0] if low_ns < r.stamp_ns <= high_ns]
        assert sample.a == pytest.approx(np.mean(within, axis=0)[:2])
        assert sample.a == pytest.approx(force(seconds(sample) - 0.0125), abs=0.03)
        assert sample.u == pytest.approx(command(seconds(sample)), abs=80.0 / 30 + 1e-6)


@pytest.mark.parametrize(
    "rates", [(200, 50, 40), (1000, 200, 200), (50, 10, 5), (0, 20, 10)], ids=str
)
@settings(max_examples=8)
@given(cut_s=st.floats(2.0, 3.5), seed=st.integers(0, 99))
def test_causality(rates: tuple[int, int, int], cut_s: float, seed: int) -> None:
    """Later readings with other values, stamps and rates change no earlier sample."""
    cut_ns = START_NS + int(cut_s * 1e9)
    one = in_order(drive(5.0, *rates, jitter=0.05, noise=0.01))
    other = [
        Reading(r.source, r.stamp_ns, tuple(100.0 - 3.0 * value for value in r.values))
        for r in in_order(drive(5.0, 130, 37, 61, jitter=0.3, seed=seed + 1))
        if rates[0] or r.source is not Source.IMU
    ]
    mixed = [r for r in one if r.stamp_ns <= cut_ns] + [r for r in other if r.stamp_ns > cut_ns]
    plain = [s for s in align_samples(one) if s.stamp_ns <= cut_ns]
    changed = [s for s in align_samples(mixed) if s.stamp_ns <= cut_ns]
    assert len(plain) > 60
    assert len(plain) == len(changed)
    assert all(map(same, plain, changed))


@pytest.mark.parametrize("rates", RATES, ids=str)
@settings(max_examples=12)
@given(seed=st.integers(0, 10**6), max_delay_s=st.floats(0.0, 0.03))
def test_arrival_order_of_streams_has_no_effect(
    rates: tuple[int, int, int], seed: int, max_delay_s: float
) -> None:
    """Random delays up to 30 ms per message: bit-identical samples."""
    streams = drive(
        3.0, *rates, steering_hz=30 * (seed % 2), jitter=0.05, noise=0.01, seed=seed
    )  # fmt: skip
    plain = {s.stamp_ns: s for s in align_samples(in_order(streams))}
    moved = {s.stamp_ns: s for s in align_samples(arriving(streams, seed, max_delay_s))}
    both = [t for t in plain if t in moved and after_start(rates, (t - START_NS) * 1e-9)]
    assert len(both) > 0.8 * (3.0 - 2.0 / min(r for r in rates if r)) * 40 - 8
    assert all(same(plain[t], moved[t]) for t in both)
    assert_grid(list(moved.values()))


@pytest.mark.parametrize("rates", RATES, ids=str)
@pytest.mark.parametrize("missing", [None, Source.IMU, Source.ODOMETRY, Source.COMMAND], ids=repr)
def test_samples_are_emitted_in_time(rates: tuple[int, int, int], missing: Source | None) -> None:
    """
    At most `max_wait_s` of the other streams' time after the tick.

    Measured in stamps, the gap to the next reading is added, since it is the first to show time.
    """
    aligner = Aligner()
    stop_ns = START_NS + 2_000_000_000
    readings = [
        r for r in in_order(drive(4.0, *rates, jitter=0.05))
        if r.source is not missing or r.stamp_ns < stop_ns
    ]  # fmt: skip
    gap_ns = max(b.stamp_ns - a.stamp_ns for a, b in pairwise(readings))
    waits = []
    for reading in readings:
        for sample in aligner.push(reading):
            waits.append(reading.stamp_ns - sample.stamp_ns)
    assert min(waits) >= 0
    first = 1 + round(1.0 / min(r for r in rates[1:] if r) * 40)
    assert max(waits[first:]) <= MAX_WAIT_NS + gap_ns


def test_samples_wait_only_for_readings_that_are_due() -> None:
    """At 200, 50 and 40 Hz in order: at most until the next odometry or command."""
    aligner, waits = Aligner(), []
    for reading in in_order(drive(6.0)):
        for sample in aligner.push(reading):
            waits.append(reading.stamp_ns - sample.stamp_ns)
    assert max(waits[5:]) <= 25_000_000
    assert np.median(waits) <= 10_000_000


def test_without_waiting_the_first_later_reading_completes_a_sample() -> None:
    aligner = Aligner(max_wait_s=0.0)
    readings = in_order(drive(3.0))
    completed_at = {s.stamp_ns: r.stamp_ns for r in readings for s in aligner.push(r)}
    stamps = np.array([r.stamp_ns for r in readings])
    for tick_ns, at_ns in list(completed_at.items())[1:]:
        assert at_ns == stamps[np.searchsorted(stamps, tick_ns)]


@pytest.mark.parametrize("source", STANDARD_SOURCES)
@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_rate_change(source: Source, factor: float) -> None:
    rates = {Source.IMU: 200.0, Source.ODOMETRY: 50.0, Source.COMMAND: 40.0}
    streams = [stream(s, rate, 8.0) for s, rate in rates.items() if s is not source]
    first = stream(source, rates[source], 3.0)
    second = stream(source, rates[source] * factor, 5.0, begin_s=3.0)
    samples = align_samples(in_order([*streams, first + second]))
    assert_grid(samples)
    assert {s.flags for s in samples if seconds(s) > 4.5} == {0}
    assert np.abs(errors([s for s in samples if seconds(s) > 1.0])).max() < 0.02


def test_measured_steering_angle_replaces_the_commanded_one() -> None:
    samples = align_samples(in_order(drive(4.0, steering_hz=60)))
    assert_grid(samples)
    for sample in samples[4:]:
        assert sample.flags == 0
        assert sample.u[0] == pytest.approx(command(seconds(sample))[0], abs=80.0 / 40)
        assert sample.u[1] == pytest.approx(steering(seconds(sample)), abs=0.05 / 60)


def test_a_steering_report_that_stops_leaves_the_commanded_angle() -> None:
    imu, odometry, commands, angles = drive(4.0, steering_hz=60)
    angles = [each for each in angles if each.stamp_ns < imu[0].stamp_ns + 2 * 10**9]
    samples = align_samples(in_order([imu, odometry, commands, angles]))
    later = [each for each in samples if each.stamp_ns > angles[-1].stamp_ns + 10**8]
    assert len(later) > 70
    for each in later:
        # After the timeout, as for a vehicle that reports none.
        has_timed_out = each.stamp_ns > angles[-1].stamp_ns + 5 * 10**8
        assert each.flags == (0 if has_timed_out else Flag.COMMAND_STALE)
        assert each.u[1] == pytest.approx(command(seconds(each))[1], abs=0.05 / 40)


def test_no_sample_before_odometry_and_command_are_received() -> None:
    streams = drive(3.0)
    assert align_samples(streams[0]) == []
    assert align_samples(in_order(streams[:2])) == []
    assert align_samples(in_order([streams[0], streams[2]])) == []
    begin = [stream(Source.COMMAND, 40, 1.0, begin_s=2.0)]
    samples = align_samples(in_order([*streams[:2], *begin]))
    assert samples[0].flags == Flag.RESTART
    first_ns = begin[0][0].stamp_ns
    assert 0 <= samples[0].stamp_ns - first_ns < TICK_NS


def test_imu_that_starts_later() -> None:
    streams = [stream(Source.IMU, 200, 2.0, begin_s=2.0), *drive(4.0, 0)]
    samples = align_samples(in_order(streams))
    assert_grid(samples)
    begin_s = seconds(Sample(streams[0][0].stamp_ns, (0, 0, 0), (0, 0), (0, 0), 0))
    for sample in samples[1:]:
        assert sample.flags == (Flag.NO_IMU if seconds(sample) < begin_s else 0)


def test_imu_without_accelerometer_gives_the_yaw_rate() -> None:
    streams = drive(6.0)
    streams[0] = [r._replace(values=(math.nan, math.nan, r.values[2])) for r in streams[0]]
    samples = [s for s in align_samples(in_order(streams)) if seconds(s) > 1.0]
    assert all(s.flags == 0 and math.isnan(s.a[0]) and math.isnan(s.a[1]) for s in samples)
    assert np.abs(errors(samples)).max() < 1e-3


def test_accelerometer_that_stops_reporting() -> None:
    """Without a full averaging window, the state comes from odometry or is missing."""
    streams = drive(4.0)
    for k, reading in enumerate(streams[0]):
        if reading.stamp_ns > START_NS + 2 * 10**9:
            streams[0][k] = reading._replace(values=(math.nan, math.nan, reading.values[2]))
    for sample in align_samples(in_order(streams))[1:]:
        assert sample.flags in (0, Flag.COASTING)
        if not sample.flags:
            assert np.abs(errors([sample])).max() < 0.01


@pytest.mark.parametrize("rate_hz", [5, 10, 20])
def test_slow_streams_are_completed_by_the_clock(rate_hz: int) -> None:
    """`advance` completes samples between rare readings."""
    aligner, samples, waits = Aligner(), [], []
    readings = in_order(drive(5.0, 0, rate_hz, rate_hz))
    now_ns = readings[0].stamp_ns
    for reading in readings:
        while now_ns < reading.stamp_ns:
            for sample in aligner.advance(now_ns):
                samples.append(sample)
                waits.append(now_ns - sample.stamp_ns)
            now_ns += 12_500_000
        samples += aligner.push(reading)
    assert_grid(samples)
    assert len(waits) > 30
    assert max(waits) <= MAX_WAIT_NS + 12_500_000
    without_clock = align_samples(readings)
    known = [s for s in samples if after_start((0, rate_hz, rate_hz), seconds(s))]
    by_stamp = {s.stamp_ns: s for s in without_clock}
    shared = [s for s in known if s.stamp_ns in by_stamp]
    assert sum(same(s, by_stamp[s.stamp_ns]) for s in shared) > 0.97 * len(shared)


def test_clock_with_another_time_base_is_ignored() -> None:
    aligner = Aligner()
    assert list(aligner.advance(START_NS)) == []
    last = [s for r in in_order(drive(2.0)) for s in aligner.push(r)][-1]
    newest_ns = aligner.newest_ns
    assert newest_ns is not None
    for now_ns in (0, newest_ns, newest_ns - 5, newest_ns + 10**9, 2 * newest_ns):
        assert list(aligner.advance(now_ns)) == []
    completed = list(aligner.advance(newest_ns + 200_000_000))
    assert_grid([last, *completed])
    assert len(completed) in range(5, 10)
    assert aligner.newest_ns == newest_ns


def test_reset_keeps_only_the_counts() -> None:
    aligner = Aligner()
    readings = in_order(drive(2.0))
    first = [s for r in [*readings, readings[-1]] for s in aligner.push(r)]
    aligner.reset()
    assert aligner.newest_ns is None
    again = [s for r in readings for s in aligner.push(r)]
    assert len(first) == len(again)
    assert all(map(same, first, again))
    assert aligner.counts == {"duplicate": 1}


def test_batch_equals_repeated_push() -> None:
    readings = arriving(drive(4.0, noise=0.01), 3, 0.02)
    aligner = Aligner()
    one_by_one = [s for r in readings for s in aligner.push(r)]
    assert all(map(same, one_by_one, align_samples(readings)))
    assert len(one_by_one) == len(align_samples(readings, Aligner()))
