# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The latest readings of each stream, in bounded memory, as the sensor log of a short stretch."""

from __future__ import annotations

import math

import numpy as np

from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import Reading, Source

_SPAN_S = 30.0
"""s of readings kept: far more than a block with its warm-up."""
_CAPACITY = 65_536
"""Most readings of a stream: a span at 2000 Hz."""
_MAX_HELD_S = 0.5
"""s before a stretch to which the stamp of the command in force is moved, if it is older."""
_MIN_READINGS = 10
"""Least readings of a stream in a stretch, as `recording.from_bag` needs."""


class _Series:
    """Rows of time and values, ascending, in one array that is compacted when it is full."""

    def __init__(self, width: int) -> None:
        self._rows = np.empty((1024, 1 + width))
        self._count = 0

    @property
    def newest_s(self) -> float:
        return float(self._rows[self._count - 1, 0]) if self._count else -math.inf

    def append(self, at_s: float, values: tuple[float, ...]) -> bool:
        """Add a row; return whether it is newer than all others."""
        if at_s <= self.newest_s:
            return False
        if self._count == self._rows.shape[0]:
            self._make_room()
        self._rows[self._count, 0] = at_s
        self._rows[self._count, 1:] = values
        self._count += 1
        return True

    def _make_room(self) -> None:
        used = self._rows[: self._count]
        keep = used[max(int(np.searchsorted(used[:, 0], self.newest_s - _SPAN_S)) - 1, 0) :]
        keep = keep[-(_CAPACITY // 2) :].copy()
        if 2 * keep.shape[0] > self._rows.shape[0]:
            self._rows = np.empty((2 * self._rows.shape[0], self._rows.shape[1]))
        self._rows[: keep.shape[0]] = keep
        self._count = keep.shape[0]

    def between(self, begin_s: float, end_s: float, with_previous: bool = False) -> FloatArray:
        """Return the rows in a time span, and the one before if wanted."""
        used = self._rows[: self._count]
        first, last = np.searchsorted(used[:, 0], (begin_s, end_s))
        if with_previous and first > 0 and (first == last or used[first, 0] > begin_s):
            first -= 1
        return np.array(used[first:last])


class SensorBuffer:
    """
    Collects readings; times are seconds from the first one.

    `start_ns` is the stamp of the first reading. Readings that are not newer than the last of
    their stream, and IMU readings without accelerations, are counted in `ignored`. `length_scale`
    is that of the vehicle.
    """

    def __init__(self, length_scale: float = 1.0) -> None:
        self.start_ns: int | None = None
        self.ignored = 0
        self._length_scale = length_scale
        self._imu, self._odometry, self._command = _Series(3), _Series(6), _Series(2)
        self._steering: float | None = None
        self._torque, self._heading = 0.0, 0.0

    def seconds(self, stamp_ns: int) -> float:
        """Return the time of a stamp."""
        return 0.0 if self.start_ns is None else (stamp_ns - self.start_ns) * 1e-9

    def push(self, reading: Reading, pose: tuple[float, float, float] | None = None) -> None:
        """Add a reading; `pose` (x, y, heading) belongs to one of odometry."""
        if self.start_ns is None:
            self.start_ns = reading.stamp_ns
        at_s, values = self.seconds(reading.stamp_ns), reading.values
        if reading.source is Source.IMU:
            taken = all(map(math.isfinite, values)) and self._imu.append(at_s, values)
        elif reading.source is Source.ODOMETRY:
            x, y, heading = pose or (0.0, 0.0, 0.0)
            # Unwrapped, as in a sensor log.
            turn = math.remainder(heading - self._heading, math.tau)
            taken = self._odometry.append(at_s, (*values, x, y, self._heading + turn))
            if taken:
                self._heading += turn
        elif reading.source is Source.COMMAND:
            angle = values[1] if self._steering is None else self._steering
            self._torque = values[0]
            taken = self._command.append(at_s, (self._torque, angle))
        else:
            self._steering = values[0]
            taken = self._command.append(at_s, (self._torque, self._steering))
        self.ignored += not taken

    @property
    def measured_until_s(self) -> float:
        """Time up to which both sensors have readings."""
        return min(self._imu.newest_s, self._odometry.newest_s)

    @property
    def newest_s(self) -> float:
        """Time of the newest reading of any sensor."""
        return max(self._imu.newest_s, self._odometry.newest_s)

    def log(self, begin_s: float, end_s: float) -> SensorLog | None:
        """Return the readings of a stretch, or None if a stream has too few."""
        imu, odometry = self._imu.between(begin_s, end_s), self._odometry.between(begin_s, end_s)
        command = self._command.between(begin_s, end_s, with_previous=True)
        enough = min(imu.shape[0], odometry.shape[0]) >= _MIN_READINGS
        if not enough or not command.shape[0] or command[0, 0] > begin_s:
            return None
        command[0, 0] = max(command[0, 0], begin_s - _MAX_HELD_S)
        return SensorLog(
            "drive",
            end_s - begin_s,
            imu[:, 0],
            imu[:, 1:],
            odometry[:, 0],
            odometry[:, 1:4],
            odometry[:, 4:],
            command[:, 0],
            command[:, 1:],
            self.start_ns or 0,
            length_scale=self._length_scale,
        )
