# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Records: the causal samples as arrays, and the non-causal reference measurement."""

import numpy as np
import pytest
from helpers.signals import START_NS, arriving, drive, in_order, seconds, state, without
from hypothesis import given
from hypothesis import strategies as st

from adk_ros.errors import DataError
from adk_ros.numerics.arrays import IntArray
from adk_ros.signals.align import Aligner, align_samples
from adk_ros.signals.channels import TICK_NS, Flag, Reading, Record, Sample, Source
from adk_ros.signals.record import build_record, reference

S = 1_000_000_000


def truth(record: Record) -> np.ndarray:
    return np.array([state((int(t) - START_NS) * 1e-9) for t in record.stamp_ns])


def ticks(after_s: float, until_s: float) -> IntArray:
    first = -(-(START_NS + round(after_s * S)) // TICK_NS)
    last = (START_NS + round(until_s * S)) // TICK_NS
    return np.arange(first, last + 1, dtype=np.int64) * TICK_NS


def linear(source: Source, stamps: np.ndarray) -> list[Reading]:
    """Return a stream on straight lines: 1 + t, 2 - 3 t, 0.1 + 0.2 t."""
    return [
        Reading(source, int(t), (1.0 + s, 2.0 - 3.0 * s, 0.1 + 0.2 * s))
        for t, s in ((t, (t - START_NS) * 1e-9) for t in stamps)
    ]


def test_columns_equal_the_samples() -> None:
    readings = arriving(drive(5.0, noise=0.01), 5, 0.02)
    samples = align_samples(readings)
    counts: dict[str, int] = {}
    watched: list[Sample] = []
    record = build_record(readings, "town", counts, watched.append)
    assert watched == samples
    assert record.name == "town"
    assert len(record) == len(samples)
    assert record.duration_s == pytest.approx(len(samples) * 0.025)
    assert record.stamp_ns.tolist() == [s.stamp_ns for s in samples]
    assert record.flags.tolist() == [s.flags for s in samples]
    assert record.learnable.tolist() == [s.learnable for s in samples]
    for name in ("x", "u", "a"):
        np.testing.assert_array_equal(getattr(record, name), [getattr(s, name) for s in samples])
    assert counts == {}
    assert set(record.episode) == {0}


def test_a_velocity_that_is_not_measured_stays_constant() -> None:
    readings = [
        item._replace(values=(item.values[0], 0.0, item.values[2]))
        if item.source is Source.ODOMETRY
        else item
        for item in arriving(drive(5.0, noise=0.01), 5, 0.02)
    ]
    # Between two odometry messages the accelerometer would move it.
    assert any(sample.x[1] for sample in align_samples(readings))
    record = build_record(readings, "town", {})
    assert not record.x[:, 1].any()
    assert record.x[:, 0].std() > 0.0


@pytest.mark.parametrize("rate_hz", [5, 10, 33, 50, 80, 97, 100, 200, 400, 1000])
@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_reference_is_exact_on_straight_lines(rate_hz: int, jitter: float) -> None:
    """At any phase; the mean over a tick would be biased by the change in half a period."""
    random = np.random.default_rng(rate_hz)
    for phase in np.linspace(0.0, 1.0, 13):
        offsets = np.arange(4 * rate_hz) + phase + jitter * random.uniform(-1, 1, 4 * rate_hz)
        stamps = START_NS + np.round(offsets * S / rate_hz).astype(np.int64)
        at = ticks(0.5, 3.5)
        found = reference(at, linear(Source.ODOMETRY, stamps))
        t = (at - START_NS) * 1e-9
        expected = np.stack([1.0 + t, 2.0 - 3.0 * t, 0.1 + 0.2 * t], axis=1)
        np.testing.assert_allclose(found, expected, atol=2e-8)


@pytest.mark.parametrize("rate_hz", [5, 50, 200, 1000])
def test_reference_is_nan_beyond_the_readings(rate_hz: int) -> None:
    stamps = START_NS + S + np.arange(rate_hz) * (S // rate_hz)
    at = ticks(0.0, 3.0)
    found = reference(at, linear(Source.ODOMETRY, stamps))
    inside = (at >= stamps[0]) & (at <= stamps[-1])
    assert np.isfinite(found[inside]).all()
    assert np.isnan(found[(at < stamps[0] - TICK_NS) | (at > stamps[-1] + TICK_NS)]).all()


@pytest.mark.parametrize("rate_hz", [50, 200, 1000])
def test_reference_over_a_gap(rate_hz: int) -> None:
    """A gap of 0.1 s is interpolated, a gap of 0.5 s is not."""
    stamps = START_NS + np.arange(4 * rate_hz) * (S // rate_hz)
    at = ticks(0.1, 3.9)
    t = (at - START_NS) * 1e-9
    for gap_s, interpolated in ((0.1, True), (0.5, False)):
        remaining = stamps[
            (stamps < START_NS + 2 * S) | (stamps > START_NS + round((2 + gap_s) * S))
        ]
        found = reference(at, linear(Source.ODOMETRY, remaining))
        inside = (t > 2.02) & (t < 2.0 + gap_s - 0.02)
        assert np.isfinite(found[inside]).all() == interpolated
        assert np.isnan(found[inside]).all() != interpolated
        outside = (t < 1.97) | (t > 2.03 + gap_s)
        np.testing.assert_allclose(found[outside, 0], 1.0 + t[outside], atol=1e-8)


def test_reference_yaw_rate_is_from_the_gyro_if_available() -> None:
    slow = START_NS + np.arange(40) * (S // 10)
    fast = START_NS + S + np.arange(200) * (S // 200)
    odometry = [r._replace(values=(1.0, 2.0, 0.5)) for r in linear(Source.ODOMETRY, slow)]
    imu = [r._replace(values=(9.0, 9.0, 0.7)) for r in linear(Source.IMU, fast)]
    at = ticks(0.2, 3.5)
    found = reference(at, odometry + imu)
    inside = (at > fast[0]) & (at < fast[-1])
    assert found[:, :2].tolist() == [[1.0, 2.0]] * len(at)
    assert found[inside, 2] == pytest.approx(0.7)
    assert found[(at < fast[0] - TICK_NS) | (at > fast[-1] + TICK_NS), 2] == pytest.approx(0.5)


def test_reference_of_too_few_readings() -> None:
    at = ticks(0.0, 1.0)
    one = linear(Source.ODOMETRY, np.array([START_NS]))
    for readings in ([], one, one * 3):
        assert np.isnan(reference(at, readings)).all()


def test_reference_smooths_a_fast_noisy_stream() -> None:
    random = np.random.default_rng(0)
    stamps = START_NS + 1_700_000 + np.arange(10 * 200) * (S // 200)
    noise = random.normal(0.0, 1.0, 2000)
    readings = [
        Reading(Source.IMU, int(t), (0.0, 0.0, float(v)))
        for t, v in zip(stamps, noise, strict=True)
    ]
    found = reference(ticks(0.5, 9.5), readings)[:, 2]
    assert np.std(found) == pytest.approx(5**-0.5, rel=0.12)


def test_reference_is_robust_against_readings_at_one_instant() -> None:
    """Noisy pairs 0.1 ms apart: no slope is computed from a pair."""
    random = np.random.default_rng(0)
    stamps = (START_NS + np.arange(200)[:, None] * 20_000_000 + [0, 100_000]).ravel()
    readings = [
        Reading(Source.ODOMETRY, int(t), (float(10.0 + random.normal(0, 0.01)), 0.0, 0.0))
        for t in stamps
    ]
    found = reference(ticks(0.1, 3.9), readings)[:, 0]
    assert np.abs(found - 10.0).max() < 0.06


def test_first_of_duplicates_is_used() -> None:
    readings = in_order(drive(3.0))
    doubled = [d for r in readings for d in (r, r._replace(values=tuple(-v for v in r.values)))]
    one, other = build_record(readings), build_record(doubled)
    np.testing.assert_array_equal(one.x, other.x)
    np.testing.assert_array_equal(one.x_ref, other.x_ref)


@pytest.mark.parametrize(
    "rates", [(200, 50, 40), (0, 50, 40), (1000, 10, 5), (50, 200, 200)], ids=str
)
def test_reference_is_more_accurate_than_the_state(rates: tuple[int, int, int]) -> None:
    record = build_record(in_order(drive(20.0, *rates, noise=0.01)))
    known = np.asarray(np.isfinite(record.x_ref).all(axis=1))
    assert known[5:-10].all()
    reference_error = np.std((record.x_ref - truth(record))[known][40:], axis=0)
    state_error = np.std((record.x - truth(record))[known][40:], axis=0)
    assert (reference_error < state_error * 1.02).all()
    assert (reference_error < 0.013).all()


def test_gap_in_odometry() -> None:
    record = build_record(without(in_order(drive(8.0, 0)), Source.ODOMETRY, 3.0, 5.0))
    t = np.array([seconds(s) for s in align_samples(in_order(drive(8.0, 0)))])[: len(record)]
    assert np.isnan(record.x_ref[(t > 3.05) & (t < 4.95)]).all()
    assert np.isfinite(record.x_ref[(t < 2.9) | ((t > 5.05) & (t < 7.9))]).all()
    # The samples continue, so it is one episode; samples without a state are flagged.
    assert set(record.episode) == {0}
    assert not record.learnable[(t > 3.15) & (t < 4.95)].any()


@pytest.mark.parametrize("by_s", [-1000.0, -3.0, 3.0, 1000.0])
def test_epochs_do_not_mix(by_s: float) -> None:
    """After a clock jump, stamps of two segments may overlap, but their values do not mix."""
    first = in_order(drive(4.0))
    second = [
        r._replace(stamp_ns=r.stamp_ns + round(by_s * S), values=tuple(v + 7.0 for v in r.values))
        for r in in_order(drive(4.0, begin_s=4.0))
    ]
    record = build_record([*first, *second])
    assert sorted(set(record.episode)) == [0, 1]
    (begin,) = np.flatnonzero(np.diff(record.episode)) + 1
    assert record.flags[begin] & Flag.RESTART
    assert np.nanmax(record.x_ref[:begin, 1]) < 1.0 < 6.0 < np.nanmin(record.x_ref[begin:, 1])
    alone = build_record(second)
    np.testing.assert_array_equal(record.x_ref[begin:], alone.x_ref)
    np.testing.assert_array_equal(record.x[begin:], alone.x)


def test_implausible_stamps_do_not_affect_the_reference() -> None:
    readings = in_order(drive(4.0))
    outlier = readings[300]._replace(stamp_ns=readings[300].stamp_ns + 10**12, values=(99.0,) * 3)
    counts: dict[str, int] = {}
    record = build_record([*readings[:300], outlier, *readings[300:]], aligner_counts=counts)
    np.testing.assert_array_equal(record.x_ref, build_record(readings).x_ref)
    assert counts == {"stray stamp": 1}


@pytest.mark.parametrize(
    ("rates", "reason"),
    [
        ((200, 0, 40), "town has no usable odometry messages"),
        ((200, 50, 0), "town has no usable command messages"),
        ((200, 0, 0), "town has no usable odometry and no command messages"),
        ((0, 0, 0), "town has no usable odometry and no command messages"),
    ],
)
def test_missing_stream(rates: tuple[int, int, int], reason: str) -> None:
    with pytest.raises(DataError, match=reason):
        build_record(in_order(drive(2.0, *rates)), "town")


def test_too_short() -> None:
    with pytest.raises(DataError, match="the recording is too short"):
        build_record(in_order(drive(0.02, 0, 50, 50)))


def test_rows() -> None:
    record = build_record(in_order(drive(3.0)), "town")
    part = record.rows(slice(10, 20))
    assert len(part) == 10
    assert part.name == "town"
    np.testing.assert_array_equal(part.x, record.x[10:20])
    np.testing.assert_array_equal(record.rows(record.episode == 0).x_ref, record.x_ref)


@given(st.integers(1, 400))
def test_batch_equals_incremental(cut: int) -> None:
    """One call or several calls give the same samples."""
    readings = in_order(drive(1.5, noise=0.01))
    aligner = Aligner()
    samples = align_samples(readings[:cut], aligner) + align_samples(readings[cut:], aligner)
    record = build_record(iter(readings))
    assert record.stamp_ns.tolist() == [s.stamp_ns for s in samples]
    np.testing.assert_array_equal(record.x, [s.x for s in samples])
