# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Distinguish single implausible time stamps from jumps of the clock.

A reading whose stamp deviates from the newest accepted one by more than `jump_s`, in either
direction, is withheld. If the next readings agree with it, the clock has jumped (a looping bag, a
restarted simulation, a long gap), and all earlier readings belong to another time. If the next
reading agrees with the previous time, the withheld readings had wrong stamps.
"""

from __future__ import annotations

from enum import Enum

from adk_ros.signals.channels import Reading

_CONFIRMATIONS = 3
"""Consistent readings that confirm a jump: two wrong stamps in a row cause none."""


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

    def follows(self, stamp_ns: int) -> bool:
        """
        Accept a stamp close to the newest one if no reading is pending.

        Return whether it was accepted. If not, nothing has changed: call `check_stamp`.
        """
        newest_ns = self.newest_ns
        if newest_ns is None or self.pending or abs(stamp_ns - newest_ns) > self._jump_ns:
            return False
        if stamp_ns > newest_ns:
            self.newest_ns = stamp_ns
        return True

    def check_stamp(self, reading: Reading) -> tuple[StampVerdict, list[Reading]]:
        """
        Return the treatment of a reading, and the pending readings that it resolves.

        With ACCEPT and HOLD, the returned readings had wrong stamps and are to be counted. With
        JUMP, they are all pending readings in order of arrival, the first of the new time.
        """
        if self.newest_ns is None or abs(reading.stamp_ns - self.newest_ns) <= self._jump_ns:
            outliers, self.pending = self.pending, []
            if self.newest_ns is None or reading.stamp_ns > self.newest_ns:
                self.newest_ns = reading.stamp_ns
            return StampVerdict.ACCEPT, outliers
        if self.pending and abs(reading.stamp_ns - self.pending[-1].stamp_ns) > self._jump_ns:
            outliers, self.pending = self.pending, [reading]
            return StampVerdict.HOLD, outliers
        self.pending.append(reading)
        if len(self.pending) < _CONFIRMATIONS:
            return StampVerdict.HOLD, []
        confirmed, self.pending = self.pending, []
        self.newest_ns = max(item.stamp_ns for item in confirmed)
        return StampVerdict.JUMP, confirmed

    def reset(self) -> None:
        """Accept the next stamp unconditionally."""
        self.newest_ns = None
        self.pending = []
