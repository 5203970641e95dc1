# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Distinguish single implausible time stamps from jumps of the clock.

A reading whose stamp deviates from the newest accepted one by more than `jump_s`, in either
direction, is withheld. If the next readings agree with it, the clock has jumped (a looping bag, a
restarted simulation, a long gap), and all earlier readings belong to another time. If the next
reading agrees with the previous time, the withheld readings had wrong stamps.

Time is that of odometry and commands, without which nothing is predicted: an IMU alone, which most
vehicles publish most often, neither confirms a jump nor refutes one.
"""

from __future__ import annotations

from enum import Enum

from adk_ros.signals.channels import Reading, Source

_CONFIRMATIONS = 3
"""Consistent readings that confirm a jump: two wrong stamps in a row cause none."""
_MAX_PENDING = 100
"""IMU readings that wait for odometry or a command to confirm a jump: 0.1 s at 1000 Hz. Older ones
count as wrong."""
_IMU = Source.IMU


class StampVerdict(Enum):
    """Treatment of a reading."""

    ACCEPT = "accept"
    HOLD = "hold"
    JUMP = "jump"


class ClockGuard:
    """Checks the stamps of readings one by one; `pending` readings wait for confirmation."""

    def __init__(self, jump_s: float = 1.0) -> None:
        self._jump_ns = round(jump_s * 1e9)
        self.newest_ns: int | None = None
        """Newest accepted stamp, None before the first."""
        self.pending: list[Reading] = []
        self._is_imu_time = False

    def follows(self, reading: Reading) -> bool:
        """
        Accept a reading stamped close to the newest one if no reading is pending.

        Return whether it was accepted. If not, nothing has changed: call `check_stamp`.
        """
        stamp_ns, newest_ns = reading.stamp_ns, self.newest_ns
        if newest_ns is None or self.pending or abs(stamp_ns - newest_ns) > self._jump_ns:
            return False
        if stamp_ns > newest_ns:
            self.newest_ns = stamp_ns
        if self._is_imu_time:
            self._is_imu_time = reading.source is _IMU
        return True

    def check_stamp(self, reading: Reading) -> tuple[StampVerdict, list[Reading]]:
        """
        Return the treatment of a reading, and the pending readings that it resolves.

        With ACCEPT and HOLD, the returned readings had wrong stamps and are to be counted. With
        JUMP, they are all pending readings in order of arrival, the first of the new time.
        """
        if self.newest_ns is None or abs(reading.stamp_ns - self.newest_ns) <= self._jump_ns:
            return StampVerdict.ACCEPT, self._accept(reading)
        outliers: list[Reading] = []
        if self.pending and abs(reading.stamp_ns - self.pending[-1].stamp_ns) > self._jump_ns:
            if reading.source is _IMU and not _all_of_imu(self.pending):
                return StampVerdict.HOLD, [reading]
            outliers, self.pending = self.pending, []
        self.pending.append(reading)
        enough = len(self.pending) >= _CONFIRMATIONS
        if enough and (self._is_imu_time or not _all_of_imu(self.pending)):
            confirmed, self.pending = self.pending, []
            self.newest_ns = max(item.stamp_ns for item in confirmed)
            self._is_imu_time = _all_of_imu(confirmed)
            return StampVerdict.JUMP, confirmed
        if len(self.pending) > _MAX_PENDING:
            outliers.append(self.pending.pop(0))
        return StampVerdict.HOLD, outliers

    def _accept(self, reading: Reading) -> list[Reading]:
        """Accept a reading; return the pending readings that it refutes."""
        of_imu = reading.source is _IMU
        self._is_imu_time = of_imu and (self.newest_ns is None or self._is_imu_time)
        if self.newest_ns is None or reading.stamp_ns > self.newest_ns:
            self.newest_ns = reading.stamp_ns
        if of_imu and not _all_of_imu(self.pending):
            return []
        refuted, self.pending = self.pending, []
        return refuted

    def reset(self) -> None:
        """Accept the next stamp unconditionally."""
        self.newest_ns = None
        self.pending = []
        self._is_imu_time = False


def _all_of_imu(readings: list[Reading]) -> bool:
    return all(reading.source is _IMU for reading in readings)
