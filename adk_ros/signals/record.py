# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Build a `Record`: the aligner's samples as arrays, and a non-causal reference measurement.

The samples come from the same `Aligner.push` that runs on the vehicle. The non-causal (two-sided)
reference measurement `x_ref` uses the readings on both sides of a tick. It is kept separate:
predictions are scored against it but never start from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from adk_ros.errors import DataError
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.signals.align import Aligner
from adk_ros.signals.channels import TICK_NS, Flag, Reading, Record, Sample, Source

_HALF_TICK_NS = TICK_NS // 2
_MAX_GAP_NS = 150_000_000
"""ns; gaps up to this length, or `_MAX_GAP_PERIODS`, are interpolated: six samples."""
_MAX_GAP_PERIODS = 2.5
"""Periods of a slow stream up to which gaps are interpolated: one lost message is."""
_MIN_FILL = 0.8
"""Share of the expected readings within a tick that a line fit requires."""
_MIN_SPREAD_S = TICK_NS * 1e-9 / 8.0
"""s; standard deviation of the readings' times that a line fit requires.

Evenly spaced readings have 0.29 ticks, readings that bunch up at one instant 0."""


class _RecordingAligner(Aligner):
    """An aligner that stores its accepted readings, by epoch between clock jumps."""

    def __init__(self) -> None:
        self.epochs: list[list[Reading]] = []
        super().__init__()

    def _begin(self) -> None:
        self.epochs.append([])
        super()._begin()

    def _insert(self, reading: Reading) -> None:
        self.epochs[-1].append(reading)
        super()._insert(reading)


def build_record(
    readings: Iterable[Reading],
    name: str = "",
    aligner_counts: dict[str, int] | None = None,
    watch: Callable[[Sample], None] | None = None,
) -> Record:
    """
    Return the record of a recording's readings, which are in order of arrival.

    :param name: name of the recording, for messages.
    :param aligner_counts: if given, receives the counts of the aligner.
    :param watch: called with each sample.
    :raises DataError: no sample: a stream is missing, or the recording is too short.
    """
    aligner = _RecordingAligner()
    samples: list[Sample] = []
    epoch_of: list[int] = []
    for reading in readings:
        new = aligner.push(reading)
        samples.extend(new)
        if watch is not None:
            for sample in new:
                watch(sample)
        epoch_of.extend([len(aligner.epochs) - 1] * len(new))
    if aligner_counts is not None:
        aligner_counts.update(aligner.counts)
    if not samples:
        present = {reading.source for epoch in aligner.epochs for reading in epoch}
        missing = [s.name.lower() for s in (Source.ODOMETRY, Source.COMMAND) if s not in present]
        fault = f"has no usable {' and no '.join(missing)} messages" if missing else "is too short"
        raise DataError(f"{name or 'the recording'} {fault}: no 25 ms sample could be formed")
    return _assemble(samples, np.array(epoch_of), aligner.epochs, name)


def _assemble(
    samples: list[Sample], epoch_of: IntArray, epochs: list[list[Reading]], name: str
) -> Record:
    stamp_ns = np.array([s.stamp_ns for s in samples], dtype=np.int64)
    x_ref = np.full((len(samples), 3), np.nan)
    for number, readings in enumerate(epochs):
        rows = epoch_of == number
        if rows.any():
            x_ref[rows] = reference(stamp_ns[rows], readings)
    flags = np.array([s.flags for s in samples], dtype=np.int64)
    breaks = np.concatenate([[False], np.diff(stamp_ns) != TICK_NS])
    breaks |= (flags & int(Flag.RESTART)) != 0
    episode = np.cumsum(breaks)
    record = Record(
        stamp_ns=stamp_ns,
        x=np.array([s.x for s in samples]),
        u=np.array([s.u for s in samples]),
        a=np.array([s.a for s in samples]),
        flags=flags,
        x_ref=x_ref,
        episode=episode - episode[0],
        name=name,
    )
    # Of a velocity that is not measured, only what the IMU adds between two odometry messages
    # would change.
    for i in np.flatnonzero(~record.measured):
        record.x[:, i] = np.nanmin(x_ref[:, i])
    return record


def reference(stamp_ns: IntArray, readings: list[Reading]) -> FloatArray:
    """
    Return the non-causal reference measurement (n, 3) of v_x, v_y, yaw rate at `stamp_ns` (n,).

    A stream of at least 80 Hz is smoothed by a line fitted to the readings within half a tick of
    the instant; a slower one is interpolated linearly. NaN where readings are too far apart. Yaw
    rate is the gyro's if available.
    """
    odometry = _columns(readings, Source.ODOMETRY)
    imu = _columns(readings, Source.IMU)
    result = np.full((stamp_ns.shape[0], 3), np.nan)
    if odometry is not None:
        result[:] = _smoothed(stamp_ns, *odometry)
    if imu is not None:
        gyro = _smoothed(stamp_ns, imu[0], imu[1][:, 2:3])[:, 0]
        result[:, 2] = np.where(np.isfinite(gyro), gyro, result[:, 2])
    return result


def _columns(readings: list[Reading], source: Source) -> tuple[IntArray, FloatArray] | None:
    chosen = [r for r in readings if r.source is source]
    stamps = np.array([r.stamp_ns for r in chosen], dtype=np.int64)
    # Of duplicates the first is kept, as in the aligner.
    unique, index = np.unique(stamps, return_index=True)
    if unique.shape[0] < 2:
        return None
    values = np.array([r.values for r in chosen], dtype=np.float64)
    return unique, values[index]


def _smoothed(at_ns: IntArray, stamps: IntArray, values: FloatArray) -> FloatArray:
    period = float(np.median(np.diff(stamps)))
    linear = _interpolated(at_ns, stamps, values, max(_MAX_GAP_NS, _MAX_GAP_PERIODS * period))
    if period > TICK_NS / 2:
        return linear
    first = np.searchsorted(stamps, at_ns - _HALF_TICK_NS, side="right")
    count = np.searchsorted(stamps, at_ns + _HALF_TICK_NS, side="right") - first
    # The value of the line at the instant, not the mean: the mean is biased by the slope times the
    # offset of the readings' centre, which is up to half their period.
    sum_t, sum_tt = np.zeros((2, at_ns.shape[0]))
    sum_y, sum_ty = np.zeros((2, at_ns.shape[0], values.shape[1]))
    for k in range(int(count.max(initial=0))):
        row = np.minimum(first + k, stamps.shape[0] - 1)
        inside = k < count
        t = np.where(inside, (stamps[row] - at_ns) * 1e-9, 0.0)
        y = np.where(inside[:, None], values[row], 0.0)
        sum_t += t
        sum_tt += t * t
        sum_y += y
        sum_ty += t[:, None] * y
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_t = sum_t / count
        spread = sum_tt - count * mean_t**2
        slope = (sum_ty - mean_t[:, None] * sum_y) / spread[:, None]
        fitted = sum_y / count[:, None] - slope * mean_t[:, None]
    # Readings that bunch up at one instant determine no slope.
    fittable: BoolArray = (count >= max(2, int(_MIN_FILL * TICK_NS / period))) & (
        spread > count * _MIN_SPREAD_S**2
    )
    return np.where(fittable[:, None], fitted, linear)


def _interpolated(
    at_ns: IntArray, stamps: IntArray, values: FloatArray, max_gap_ns: float
) -> FloatArray:
    right = np.clip(np.searchsorted(stamps, at_ns, side="left"), 1, stamps.shape[0] - 1)
    left = right - 1
    gap = (stamps[right] - stamps[left]).astype(np.float64)
    fraction = (at_ns - stamps[left]) / gap
    result = values[left] + fraction[:, None] * (values[right] - values[left])
    outside = (fraction < 0.0) | (fraction > 1.0) | (gap > max_gap_ns)
    result[outside] = np.nan
    return result
