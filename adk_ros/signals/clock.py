# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Is a stamp to be believed? Tells a stray stamp from a clock that really jumped.

A reading far from the newest accepted one (ahead by more than `jump_s`, or behind it by as much)
is not believed at once: it is held back. If the next readings agree with it, the clock has
jumped (a bag that loops, a simulation that restarts, a long silence), and everything known so far
belongs to another time. If the next reading agrees with the old time, the held ones were stray.
"""

from __future__ import annotations

from enum import Enum

from adk_ros.signals.channels import Reading

_CONFIRMATIONS = 3


class StampVerdict(Enum):
    """What is to be done with a reading."""

    ACCEPT = "accept"
    HOLD = "hold"
    JUMP = "jump"


class ClockGuard:
    """Judges one reading after the other; `held` are those that wait for confirmation."""

    def __init__(self, jump_s: float = 1.0) -> None:
        self._jump_ns = round(jump_s * 1e9)
        self.newest_ns: int | None = None
        """Newest believed stamp, or None before the first."""
        self.held: list[Reading] = []

    def follows(self, stamp_ns: int) -> bool:
        """
        Accept a stamp that needs no judgement: near the newest one, with nothing held.

        Return whether it was accepted; if not, nothing has changed and `judge` is to decide.
        """
        newest_ns = self.newest_ns
        if newest_ns is None or self.held or abs(stamp_ns - newest_ns) > self._jump_ns:
            return False
        if stamp_ns > newest_ns:
            self.newest_ns = stamp_ns
        return True

    def check_stamp(self, reading: Reading) -> tuple[StampVerdict, list[Reading]]:
        """
        Return the verdict and the readings it frees.

        ACCEPT frees nothing (`held` readings were stray and are returned to be counted), HOLD
        frees nothing, JUMP returns all held readings in order of arrival: they start a new time.
        """
        if self.newest_ns is None or abs(reading.stamp_ns - self.newest_ns) <= self._jump_ns:
            stray, self.held = self.held, []
            if self.newest_ns is None or reading.stamp_ns > self.newest_ns:
                self.newest_ns = reading.stamp_ns
            return StampVerdict.ACCEPT, stray
        if self.held and abs(reading.stamp_ns - self.held[-1].stamp_ns) > self._jump_ns:
            stray, self.held = self.held, [reading]
            return StampVerdict.HOLD, stray
        self.held.append(reading)
        if len(self.held) < _CONFIRMATIONS:
            return StampVerdict.HOLD, []
        freed, self.held = self.held, []
        self.newest_ns = max(item.stamp_ns for item in freed)
        return StampVerdict.JUMP, freed

    def reset(self) -> None:
        """Believe the next stamp, whatever it is."""
        self.newest_ns = None
        self.held = []
