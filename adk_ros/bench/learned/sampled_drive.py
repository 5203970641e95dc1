# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recording at the odometry's own sampling, as the learned models of other authors use it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from adk_ros.bags import Bag
from adk_ros.bags.recording import RecordingOptions, RecordingReader
from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import TICK_NS, Source

SAMPLE_NS = 40_000_000
"""Sampling of the recordings, which the equations of the learned models contain."""
MIN_SPEED = 5.0
"""m/s; the authors' parsers drop slower samples."""
MAX_AGE_NS = 5_000_000
"""Largest age of a sample at the tick from which adk_ros predicts: of five samples in 200 ms, one
is that new."""
_MAX_BRAKE_KPA = 2757.89990234
"""Brake pressure of a pedal at -1, from the authors' parsers."""
_JITTER_NS = 1_000_000


@dataclass(frozen=True)
class SampledDrive:
    """`stamp_ns` (n,), states `x` (n, 3) SI, `u` (n, 2): pedal in [-1, 1] and steering in rad."""

    name: str
    stamp_ns: IntArray
    x: FloatArray
    u: FloatArray

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def rows(self, part: slice) -> SampledDrive:
        """Return a part."""
        return SampledDrive(self.name, self.stamp_ns[part], self.x[part], self.u[part])


def read_sampled(path: Path) -> SampledDrive:
    """
    Read odometry and commands that are recorded together every 40 ms.

    :raises DataError: another sampling, or a command that is not a pedal.
    """
    values: dict[Source, dict[int, tuple[float, ...]]] = {s: {} for s in Source}
    with Bag(path) as bag:
        for reading in RecordingReader(bag, RecordingOptions()).readings():
            values[reading.source][reading.stamp_ns] = reading.values
    states, commands = values[Source.ODOMETRY], values[Source.COMMAND]
    stamps = sorted(states.keys() & commands.keys())
    stamp_ns = np.array(stamps, dtype=np.int64)
    gaps = np.diff(stamp_ns)
    if not gaps.size or np.abs(gaps - SAMPLE_NS).max() > _JITTER_NS:
        raise DataError(
            f"{path.name}: the learned models need odometry and commands with the same stamps,"
            " every 40 ms without a gap"
        )
    x = np.array([states[stamp] for stamp in stamps])
    u = np.array([commands[stamp][:2] for stamp in stamps])
    if np.abs(u[:, 0]).max() > 1.0:
        raise DataError(f"{path.name}: the learned models need a pedal in [-1, 1], not a torque")
    return SampledDrive(path.name, stamp_ns, x, u)


def write_csv(drive: SampledDrive, path: Path) -> None:
    """Write the columns that the authors' parsers read by name; `pedal` is our own."""
    pedal = drive.u[:, 0]
    none = np.zeros(len(drive))
    table = np.column_stack([
        drive.x, drive.u,
        100.0 * np.maximum(pedal, 0.0), _MAX_BRAKE_KPA * np.maximum(-pedal, 0.0), none, none, none,
    ])  # fmt: skip
    header = "vx(m/s),vy(m/s),omega(rad/s),pedal,delta(rad),throttle_ped_cmd(%),"
    header += "brake_ped_cmd(kPa),x(m),y(m),phi(rad)"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.17g")


def starts(drive: SampledDrive, first: int, history: int, ahead: int) -> tuple[IntArray, IntArray]:
    """
    Return samples to predict from, and the tick (multiple of 25 ms) that follows each, in ns.

    From `history` samples before to `ahead` after, all are faster than `MIN_SPEED` and not before
    `first`. A tick follows within `MAX_AGE_NS`, so that all predictors start from the same sample.
    """
    slow = np.abs(drive.x[:, 0]) < MIN_SPEED
    before = np.concatenate([[0], np.cumsum(slow)])
    rows = np.arange(first + history, len(drive) - ahead)
    rows = rows[before[rows + ahead + 1] == before[rows - history]]
    tick_ns = -(-drive.stamp_ns[rows] // TICK_NS) * TICK_NS
    near = tick_ns - drive.stamp_ns[rows] <= MAX_AGE_NS
    return rows[near], tick_ns[near]
