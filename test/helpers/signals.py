# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Helpers for the signals tests: an exactly known smooth motion, and its sensors."""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from adk_ros.signals.channels import TICK_NS, Reading, Sample, Source

START_NS = 1_700_000_000_003_217_911
"""ns; not a multiple of any period."""
Rows = Sequence[Reading]


def state(time_s: float) -> tuple[float, float, float]:
    """Return v_x, v_y, yaw_rate of the drive: a slalom with changing speed."""
    return (
        15.0 + 3.0 * math.sin(0.4 * time_s),
        -0.3 * math.sin(0.9 * time_s + 0.4),
        0.4 * math.sin(0.9 * time_s),
    )


def force(time_s: float) -> tuple[float, float]:
    """Return a_x, a_y: the time derivatives of the velocity, corrected for the rotating frame."""
    v_x, v_y, rate = state(time_s)
    return (
        3.0 * 0.4 * math.cos(0.4 * time_s) - rate * v_y,
        -0.3 * 0.9 * math.cos(0.9 * time_s + 0.4) + rate * v_x,
    )


def command(time_s: float) -> tuple[float, float]:
    """Return torque, delta."""
    return 200.0 * math.cos(0.4 * time_s), 0.06 * math.sin(0.9 * time_s + 0.2)


def steering(time_s: float) -> float:
    """Return the measured road-wheel angle: 0.9 of the command 0.1 s before."""
    return 0.9 * command(time_s - 0.1)[1]


def values(source: Source, time_s: float) -> tuple[float, ...]:
    """Return the values of an ideal sensor of `source`."""
    if source is Source.IMU:
        return (*force(time_s), state(time_s)[2])
    if source is Source.STEERING:
        return (steering(time_s),)
    return state(time_s) if source is Source.ODOMETRY else command(time_s)


def stream(
    source: Source,
    rate_hz: float,
    duration_s: float,
    *,
    phase: float = 0.3,
    jitter: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
    begin_s: float = 0.0,
    start_ns: int = START_NS,
) -> list[Reading]:
    """
    Return the readings of one sensor from `begin_s` on; `phase` and `jitter` are in periods.

    Jitter shifts the stamps; each reading is correct at its stamp.
    """
    return list(
        _stream(source, rate_hz, duration_s, phase, jitter, noise, seed, begin_s, start_ns)
    )


@lru_cache(maxsize=48)
def _stream(
    source: Source,
    rate_hz: float,
    duration_s: float,
    phase: float,
    jitter: float,
    noise: float,
    seed: int,
    begin_s: float,
    start_ns: int,
) -> tuple[Reading, ...]:
    random = np.random.default_rng((seed, int(source)))
    period_s = 1.0 / rate_hz
    readings = []
    for index in range(round(duration_s * rate_hz)):
        time_s = begin_s + (index + phase + jitter * random.uniform(-1.0, 1.0)) * period_s
        offset_ns = round(time_s * 1e9)
        exact = values(source, offset_ns * 1e-9)
        measured = tuple(value + noise * random.normal() for value in exact)
        readings.append(Reading(source, start_ns + offset_ns, tuple(map(float, measured))))
    return tuple(readings)


def drive(
    duration_s: float,
    imu_hz: float = 200.0,
    odometry_hz: float = 50.0,
    command_hz: float = 40.0,
    *,
    steering_hz: float = 0.0,
    jitter: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
    begin_s: float = 0.0,
    start_ns: int = START_NS,
) -> list[list[Reading]]:
    """Return the readings of all sensors, out of phase; a rate of 0 omits a sensor."""
    rates = (imu_hz, odometry_hz, command_hz, steering_hz)
    return [
        stream(
            source, rate, duration_s, phase=0.29 + 0.17 * source, jitter=jitter, noise=noise,
            seed=seed, begin_s=begin_s, start_ns=start_ns,
        )
        for source, rate in zip(Source, rates, strict=True)
        if rate
    ]  # fmt: skip


def in_order(streams: Iterable[Rows]) -> list[Reading]:
    """Return all readings in the order of their stamps."""
    return sorted((r for rows in streams for r in rows), key=lambda r: (r.stamp_ns, r.source))


def arriving(streams: Iterable[Rows], seed: int, max_delay_s: float) -> list[Reading]:
    """Return all readings in order of arrival after random delays; each stream stays in order."""
    random = np.random.default_rng(seed)
    events = []
    for rows in streams:
        last_ns = 0
        for reading in rows:
            delay_ns = int(random.uniform(0.0, max_delay_s) * 1e9)
            last_ns = max(reading.stamp_ns + delay_ns, last_ns + 1)
            events.append((last_ns, int(reading.source), reading))
    return [reading for _, _, reading in sorted(events, key=lambda event: event[:2])]


def without(rows: Iterable[Reading], source: Source, after_s: float, until_s: float) -> Rows:
    """Return the readings without those of `source` in a time interval."""
    low, high = START_NS + int(after_s * 1e9), START_NS + int(until_s * 1e9)
    return [r for r in rows if not (r.source is source and low <= r.stamp_ns < high)]


def seconds(sample: Sample, start_ns: int = START_NS) -> float:
    """Return the time of a sample since the start, s."""
    return (sample.stamp_ns - start_ns) * 1e-9


def errors(samples: Iterable[Sample], start_ns: int = START_NS) -> npt.NDArray[np.float64]:
    """Return the state errors of the samples, (n, 3)."""
    return np.array([np.subtract(s.x, state(seconds(s, start_ns))) for s in samples])


def assert_grid(samples: Sequence[Sample]) -> None:
    """Require consecutive ticks on the grid, each exactly once."""
    stamps = [sample.stamp_ns for sample in samples]
    assert all(stamp % TICK_NS == 0 for stamp in stamps)
    assert stamps == list(range(stamps[0], stamps[-1] + TICK_NS, TICK_NS))


def same(one: Sample, other: Sample) -> bool:
    """Return whether two samples are bit-identical; NaN equals NaN."""
    return repr(one) == repr(other)
