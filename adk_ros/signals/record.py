# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A whole drive: the aligner's samples in arrays, beside the measurement with hindsight.

The samples are a fold of the very `Aligner.push` that runs on the vehicle. What only hindsight
knows, the measurement interpolated between the readings on both sides of a tick, is kept apart
as `x_ref`: it is what predictions are scored against, and nothing that a prediction starts from.
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
_MAX_GAP_PERIODS = 2.5


class _Keeping(Aligner):
    """An aligner that remembers which readings it believed, by epoch between clock jumps."""

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
    Align a drive's readings (in order of arrival) and return it as a record.

    :param aligner_counts: if given, receives the aligner's counts of what was not used.
    :param watch: called with each sample as it comes about.
    :raises DataError: no tick came about: a stream is missing or too short.
    """
    aligner = _Keeping()
    samples: list[Sample] = []
    epoch_of: list[int] = []
    for reading in readings:
        fresh = aligner.push(reading)
        samples.extend(fresh)
        if watch is not None:
            for sample in fresh:
                watch(sample)
        epoch_of.extend([len(aligner.epochs) - 1] * len(fresh))
    if aligner_counts is not None:
        aligner_counts.update(aligner.counts)
    if not samples:
        present = {reading.source for epoch in aligner.epochs for reading in epoch}
        missing = [s.name.lower() for s in (Source.ODOMETRY, Source.COMMAND) if s not in present]
        what = f"has no usable {' and no '.join(missing)} messages" if missing else "is too short"
        raise DataError(f"{name or 'the drive'} {what}: no 25 ms sample could be formed")
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
    return Record(
        stamp_ns=stamp_ns,
        x=np.array([s.x for s in samples]),
        u=np.array([s.u for s in samples]),
        a=np.array([s.a for s in samples]),
        flags=flags,
        x_ref=x_ref,
        episode=episode - episode[0],
        name=name,
    )


def reference(stamp_ns: IntArray, readings: list[Reading]) -> FloatArray:
    """
    Return (n, 3): v_x, v_y, yaw rate measured at `stamp_ns` (n,), with hindsight.

    A stream at twice the grid's rate or more is smoothed by a line fitted to the half ticks
    around an instant, a slower one interpolated linearly; NaN where readings are too far apart.
    Yaw rate is the gyro's where there is one.
    """
    odometry = _columns(readings, Source.ODOMETRY)
    imu = _columns(readings, Source.IMU)
    result = np.full((stamp_ns.shape[0], 3), np.nan)
    if odometry is not None:
        result[:] = _centred(stamp_ns, *odometry)
    if imu is not None:
        gyro = _centred(stamp_ns, imu[0], imu[1][:, 2:3])[:, 0]
        result[:, 2] = np.where(np.isfinite(gyro), gyro, result[:, 2])
    return result


def _columns(readings: list[Reading], source: Source) -> tuple[IntArray, FloatArray] | None:
    chosen = [r for r in readings if r.source is source]
    stamps = np.array([r.stamp_ns for r in chosen], dtype=np.int64)
    # Of duplicates the first, as the aligner does.
    unique, index = np.unique(stamps, return_index=True)
    if unique.shape[0] < 2:
        return None
    values = np.array([r.values for r in chosen], dtype=np.float64)
    return unique, values[index]


def _centred(at_ns: IntArray, stamps: IntArray, values: FloatArray) -> FloatArray:
    period = float(np.median(np.diff(stamps)))
    linear = _interpolated(at_ns, stamps, values, max(_MAX_GAP_NS, _MAX_GAP_PERIODS * period))
    if period > TICK_NS / 2:
        return linear
    first = np.searchsorted(stamps, at_ns - _HALF_TICK_NS, side="right")
    count = np.searchsorted(stamps, at_ns + _HALF_TICK_NS, side="right") - first
    # The line's value at the instant, not the mean: that would be off by where the readings'
    # middle happens to lie, up to half their period, times the signal's slope.
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
    # Readings bunched together tell no slope.
    full: BoolArray = (count >= max(2, int(0.8 * TICK_NS / period))) & (
        spread > count * (TICK_NS * 1e-9 / 8.0) ** 2
    )
    return np.where(full[:, None], fitted, linear)


def _interpolated(
    at_ns: IntArray, stamps: IntArray, values: FloatArray, max_gap_ns: float
) -> FloatArray:
    right = np.clip(np.searchsorted(stamps, at_ns, side="left"), 1, stamps.shape[0] - 1)
    left = right - 1
    gap = (stamps[right] - stamps[left]).astype(np.float64)
    share = (at_ns - stamps[left]) / gap
    result = values[left] + share[:, None] * (values[right] - values[left])
    outside = (share < 0.0) | (share > 1.0) | (gap > max_gap_ns)
    result[outside] = np.nan
    return result
