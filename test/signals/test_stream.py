# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recent readings of a stream: extrapolation, mean, period estimate, bounded memory."""

import math
import random
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adk_ros.signals.stream import SampledStream

MS = 1_000_000
BEGIN = 1_700_000_000_000_000_000


def filled(stamps_ms: list[float], slope: float = 2.0) -> SampledStream:
    """Return a stream of readings on a straight line, and its negative as second channel."""
    stream = SampledStream()
    for ms in stamps_ms:
        value = 1.0 + slope * ms * 1e-3
        stream.add(BEGIN + round(ms * MS), (value, -value))
    return stream


def evenly(rate_hz: float, seconds: float = 1.0, phase_ms: float = 0.0) -> list[float]:
    return [phase_ms + 1e3 * k / rate_hz for k in range(round(rate_hz * seconds))]


def test_empty_stream() -> None:
    stream = SampledStream()
    assert not stream
    assert stream.at_or_before(BEGIN) is None
    assert stream.extrapolate(BEGIN) is None
    assert stream.mean(BEGIN - 1, BEGIN) is None
    assert not stream.has(BEGIN)


def test_one_reading_is_held() -> None:
    stream = filled([0.0])
    assert stream
    assert stream.last_ns == BEGIN
    assert stream.extrapolate(BEGIN + 400 * MS) == (1.0, -1.0)
    assert stream.mean(BEGIN + 300 * MS, BEGIN + 400 * MS) == (1.0, -1.0)
    assert stream.extrapolate(BEGIN - 1) is None
    assert stream.mean(BEGIN - 9, BEGIN - 1) is None
    assert stream.at_or_before(BEGIN - 1) is None


@pytest.mark.parametrize("rate_hz", [5, 10, 30, 50, 100, 200, 400, 1000])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.99, 1.4])
def test_extrapolation_is_exact_on_a_straight_line(rate_hz: float, share: float) -> None:
    """At the newest reading and up to 1.5 periods after it: no lag."""
    stamps = evenly(rate_hz, 2.0)
    at_ms = stamps[-1] + share * 1e3 / rate_hz
    assert filled(stamps).extrapolate(BEGIN + round(at_ms * MS)) == pytest.approx(
        (1.0 + 2e-3 * at_ms, -1.0 - 2e-3 * at_ms), abs=1e-8
    )


@pytest.mark.parametrize("rate_hz", [10, 50, 200])
def test_extrapolation_is_limited(rate_hz: float) -> None:
    stamps = evenly(rate_hz)
    end = 1.0 + 2e-3 * (stamps[-1] + 1.5e3 / rate_hz)
    for later_ms in (1.5e3 / rate_hz, 500.0, 10_000.0):
        line = filled(stamps).extrapolate(BEGIN + round((stamps[-1] + later_ms) * MS))
        assert line == pytest.approx((end, -end), abs=1e-6)


def test_extrapolation_uses_no_later_reading() -> None:
    stamps = evenly(200)
    early = [ms for ms in stamps if ms <= 600.0]
    at = BEGIN + 602 * MS
    assert filled(stamps).extrapolate(at) == filled(early).extrapolate(at)
    stream = filled(early)
    for k in range(100):
        stream.add(BEGIN + (605 + 45 * k) * MS, (1e6, 1e6))
        if k < 10:
            assert stream.extrapolate(at) == filled(early).extrapolate(at)
            assert stream.at_or_before(at) == filled(early).at_or_before(at)


def test_extrapolation_noise_gain() -> None:
    """Five readings: 0.6 of the variance of one reading at the newest."""
    noise = random.Random(1)
    ends = []
    for _ in range(4000):
        stream = SampledStream()
        for k in range(12):
            stream.add(BEGIN + 5 * MS * k, (noise.gauss(0.0, 1.0),))
        line = stream.extrapolate(BEGIN + 5 * MS * 11)
        assert line is not None
        ends.append(line[0])
    assert statistics.pvariance(ends) == pytest.approx(0.6, rel=0.1)


def test_readings_at_one_instant_determine_no_slope() -> None:
    """Two noisy readings a microsecond apart would give an arbitrary slope."""
    stream = filled(evenly(50))
    later = BEGIN + 1300 * MS
    stream.add(later, (3.0, -3.0))
    stream.add(later + 1000, (3.1, -3.1))
    assert stream.extrapolate(later + 12 * MS) == (3.1, -3.1)


@given(
    st.lists(st.tuples(st.integers(1, 400 * MS), st.floats(-50, 50)), min_size=1, max_size=60),
    st.integers(0, 400 * MS),
)
def test_extrapolation_is_bounded_for_any_stamps(
    steps: list[tuple[int, float]], after_ns: int
) -> None:
    """Readings in [-50, 50] give values of at most a few times that."""
    stream, stamp_ns = SampledStream(), BEGIN
    for step_ns, value in steps:
        stamp_ns += step_ns
        stream.add(stamp_ns, (value,))
    line = stream.extrapolate(stamp_ns + after_ns)
    assert line is not None
    assert abs(line[0]) < 50.0 * 20.0


def test_mean_over_an_interval() -> None:
    stream = filled([0.0, 10.0, 20.0, 30.0])
    at = BEGIN + 30 * MS
    assert stream.mean(BEGIN, at) == pytest.approx((1.04, -1.04))
    assert stream.mean(BEGIN + 25 * MS, at) == pytest.approx((1.06, -1.06))
    assert stream.mean(BEGIN + 10 * MS, BEGIN + 20 * MS) == pytest.approx((1.04, -1.04))
    assert stream.mean(BEGIN + 31 * MS, BEGIN + 40 * MS) == pytest.approx((1.06, -1.06))


@pytest.mark.parametrize("rate_hz", [5, 12.5, 50, 200, 1000])
def test_period_estimate(rate_hz: float) -> None:
    assert filled(evenly(rate_hz, 3.0)).period_ns == pytest.approx(1e9 / rate_hz, rel=1e-3)
    assert filled(evenly(rate_hz, 2.0 / rate_hz)).period_ns == pytest.approx(1e9 / rate_hz)


@pytest.mark.parametrize(("before", "after"), [(200, 50), (50, 200), (100, 10), (10, 100)])
def test_period_follows_a_change_of_rate(before: float, after: float) -> None:
    stamps = evenly(before, 2.0)
    stream = filled(stamps + [stamps[-1] + ms for ms in evenly(after, 3.0)[1:]])
    assert stream.period_ns == pytest.approx(1e9 / after, rel=0.1)
    readings = 0
    stream, now_ms = filled(stamps), stamps[-1]
    while abs(stream.period_ns * after / 1e9 - 1.0) > 0.35:
        readings += 1
        now_ms += 1e3 / after
        stream.add(BEGIN + round(now_ms * MS), (0.0, 0.0))
    assert readings <= 35


def test_lost_message_hardly_changes_the_period() -> None:
    stamps = evenly(100)
    del stamps[60]
    stream = filled(stamps[:61])
    assert 1.05 < stream.period_ns / (10 * MS) < 1.15
    assert filled(stamps).period_ns == pytest.approx(10 * MS, rel=0.01)


def test_long_gap_hardly_changes_the_period() -> None:
    stream = filled(evenly(100))
    stream.add(BEGIN + 60_000 * MS, (0.0, 0.0))
    assert stream.period_ns < 12.5 * MS


def test_two_simultaneous_first_readings() -> None:
    stream = filled([0.0, 1e-6, *(200.0 * k for k in range(1, 40))])
    assert stream.period_ns == pytest.approx(200 * MS, rel=0.2)


def test_out_of_order_readings_are_sorted() -> None:
    stamps = evenly(100)
    shuffled = stamps.copy()
    shuffled[40], shuffled[41] = shuffled[41], shuffled[40]
    stream = filled(shuffled)
    assert stream.stamps == sorted(stream.stamps)
    for ms in stamps[-20:]:
        known = stream.at_or_before(BEGIN + round(ms * MS))
        assert known is not None
        assert known.stamp_ns == BEGIN + round(ms * MS)
        assert known.values[0] == pytest.approx(1.0 + 2e-3 * ms)
    assert stream.has(BEGIN + round(stamps[41] * MS))
    assert not stream.has(BEGIN + round(stamps[41] * MS) + 1)


def test_oldest_reading_is_inserted_first() -> None:
    stream = filled([100.0, 110.0, 5.0])
    assert stream.stamps == [BEGIN + ms * MS for ms in (5, 100, 110)]
    known = stream.at_or_before(BEGIN + 50 * MS)
    assert known is not None
    assert known.values[0] == pytest.approx(1.01)


@given(st.permutations(list(range(12))))
def test_any_order_gives_the_same_readings(order: list[int]) -> None:
    stream = filled([7.0 * k for k in order])
    assert stream.stamps == [BEGIN + 7 * MS * k for k in range(12)]
    for k in range(12):
        known = stream.at_or_before(BEGIN + (7 * k + 3) * MS)
        assert known is not None
        assert known.values[0] == pytest.approx(1.0 + 2e-3 * 7.0 * k)


@pytest.mark.parametrize("rate_hz", [5, 100, 1000])
def test_half_a_second_is_kept(rate_hz: float) -> None:
    stream = filled(evenly(rate_hz, 30.0))
    span = stream.stamps[-1] - stream.stamps[0]
    assert 500 * MS <= span <= 1000 * MS
    assert len(stream.stamps) <= rate_hz * 1.01 + 1


def test_last_reading_before_a_gap_is_kept() -> None:
    """A tick in the gap still needs the reading before it."""
    stream = filled([0.0, 100.0])
    for ms in (5000.0, 5001.0, 5002.0):
        stream.add(BEGIN + round(ms * MS), (0.0, 0.0))
        known = stream.at_or_before(BEGIN + 4999 * MS)
        assert known is not None
        assert known.stamp_ns == BEGIN + 100 * MS


def test_repeats() -> None:
    stream = SampledStream()
    values = [1.0, 2.0, 2.0, 2.0, 3.0, 3.0]
    repeats = []
    for k, value in enumerate(values):
        stream.add(BEGIN + 100 * MS * k, (value,))
        known = stream.at_or_before(stream.last_ns)
        assert known is not None
        repeats.append((known.repeats, round(known.unchanged_s(), 9)))
    assert repeats == [(0, 0.0), (0, 0.0), (1, 0.1), (2, 0.2), (0, 0.0), (1, 0.1)]


def test_nan_is_no_repetition() -> None:
    """An IMU without accelerometer reports NaN and is not frozen."""
    stream = SampledStream()
    for k in range(10):
        stream.add(BEGIN + 5 * MS * k, (math.nan, float(k)))
    known = stream.at_or_before(stream.last_ns)
    assert known is not None
    assert known.repeats == 0
