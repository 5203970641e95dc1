# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Keep readings with implausible stamps from a watch, and notice when its clock was set.

`ClockGuard` says which stamps are wrong and when all of them jump. A jump ahead is a pause, after
which the car is the same. A stream that goes back, or a pause of more than a day, is another time:
nothing before it can be compared.
"""

from __future__ import annotations

from collections import Counter
from typing import Generic, TypeVar

from adk_ros.mismatch.watch.settings import MAX_LATENESS_S
from adk_ros.signals.channels import Reading, Source
from adk_ros.signals.clock import ClockGuard, StampVerdict

MAX_DEVIATION_S = MAX_LATENESS_S + 1.0
"""s between a plausible stamp and the newest one: streams may be late, clocks be adjusted."""
_MAX_PAUSE_S = 86_400.0
"""s of a pause above which the clock was set, as on a computer that starts in 1970. By choice."""

Item = TypeVar("Item")


class StampFilter(Generic[Item]):
    """
    Withholds readings with implausible stamps, each with an item that belongs to it.

    `strays` counts the readings that were left out.
    """

    def __init__(self) -> None:
        self.strays: Counter[Source] = Counter()
        self._guard = ClockGuard(MAX_DEVIATION_S)
        self._held: dict[int, tuple[Reading, Item]] = {}
        self._newest_ns: dict[Source, int] = {}

    def admit(self, reading: Reading, item: Item) -> tuple[bool, list[tuple[Reading, Item]]]:
        """
        Return whether another time begins, and the readings to take with their items, in order.

        Usually this is the given reading. It is none while its stamp is implausible; the readings
        that confirm a jump are returned together. All readings before another time are void.
        """
        before_ns = self._guard.newest_ns
        admitted = self._plausible(reading, item)
        if not admitted:
            return False, []
        is_new = any(map(self._goes_back, (taken for taken, _ in admitted)))
        if before_ns is not None:
            is_new |= admitted[0][0].stamp_ns - before_ns > _MAX_PAUSE_S * 1e9
        if is_new:
            self._newest_ns.clear()
        for taken, _ in admitted:
            newest_ns = self._newest_ns.get(taken.source, taken.stamp_ns)
            self._newest_ns[taken.source] = max(newest_ns, taken.stamp_ns)
        return is_new, admitted

    def _plausible(self, reading: Reading, item: Item) -> list[tuple[Reading, Item]]:
        if self._guard.follows(reading):
            return [(reading, item)]
        self._held[id(reading)] = reading, item
        verdict, released = self._guard.check_stamp(reading)
        # The guard returns the objects that it was given.
        resolved = [self._held.pop(id(other)) for other in released]
        if verdict is StampVerdict.JUMP:
            return resolved
        self.strays.update(other.source for other in released)
        return [self._held.pop(id(reading))] if verdict is StampVerdict.ACCEPT else []

    def _goes_back(self, reading: Reading) -> bool:
        # Within its stream: one that was silent and delivers late is behind the others only.
        newest_ns = self._newest_ns.get(reading.source, reading.stamp_ns)
        return newest_ns - reading.stamp_ns > MAX_DEVIATION_S * 1e9
