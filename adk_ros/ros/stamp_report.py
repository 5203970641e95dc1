# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is wrong with the stamps of which stream, as text and as values of the diagnostics."""

from __future__ import annotations

from typing import NamedTuple

from adk_ros.ros.diagnostic_values import Clocks
from adk_ros.signals.channels import TICK_NS, Source
from adk_ros.signals.stamps import MAX_DELAY_S, StampMonitor, StreamStamps, leads

_UNITS = (("years", 365.25 * 86400.0), ("days", 86400.0), ("h", 3600.0), ("min", 60.0))


class StampReport(NamedTuple):
    """
    State of the stamps at one time: statistics and leads (s) by source, see `signals.stamps`.

    `clock_offset_s`: ROS clock minus monotonic clock, None while there is no simulation time.
    """

    streams: dict[Source, StreamStamps]
    leads: dict[Source, float]
    tolerance_s: float
    clock_offset_s: float | None

    def fault(self, source: Source) -> str | None:
        """Return what is wrong with the stamps of a stream, None if nothing is."""
        item = self.streams.get(source)
        name = source.name.lower()
        if item is None:
            return None
        if item.is_stuck:
            return f"{name} stamps are stuck: all are equal"
        if item.is_erratic:
            return f"{name} stamps jump back and forth by more than a second"
        lead_s = self.leads.get(source)
        if lead_s is None:
            return self._difference(source, item)
        if abs(lead_s) <= self.tolerance_s:
            return None
        others = sum(abs(value) <= self.tolerance_s for value in self.leads.values())
        reference = "the other streams" if others else "the receiver's clock"
        direction = "ahead of" if lead_s > 0.0 else "behind"
        return f"{name} stamps are {_duration(lead_s)} {direction} {reference}"

    def is_used(self, source: Source) -> bool:
        """Return whether the alignment uses readings of a stream with these stamps."""
        item = self.streams.get(source)
        if item is None or not item.is_steady:
            return item is None
        return abs(self.leads.get(source, 0.0)) <= MAX_DELAY_S

    def values(self) -> dict[str, float]:
        """Return lead and delay of each stream by key of the diagnostics, s."""
        values = {}
        for source, item in self.streams.items():
            name = source.name.lower()
            if source in self.leads:
                values[f"{name}.stamps_ahead_of_others_s"] = self.leads[source]
            if self.clock_offset_s is not None:
                values[f"{name}.stamps_behind_clock_s"] = item.delay_s + self.clock_offset_s
        return values

    def _difference(self, source: Source, item: StreamStamps) -> str | None:
        """Return a difference of two streams of which either may be wrong; named by the first."""
        for other, compared in self.streams.items():
            apart_s = abs(item.delay_s - compared.delay_s)
            if other > source and compared.is_steady and apart_s > self.tolerance_s:
                names = f"{source.name.lower()} and {other.name.lower()}"
                return f"{names} stamps are {_duration(apart_s)} apart"
        return None


def stamp_report(monitor: StampMonitor, clocks: Clocks, max_wait_s: float) -> StampReport:
    """
    Return the report at the time of `clocks`.

    Readings of streams whose leads differ by more than `max_wait_s` and a sample come too late for
    their samples: the alignment waits for a stream no longer (`signals.align`).
    """
    streams = monitor.statistics(round(clocks.now_s * 1e9))
    tolerance_s = max_wait_s + TICK_NS * 1e-9
    offset_s = clocks.ros_ns * 1e-9 - clocks.now_s if clocks.ros_ns else None
    return StampReport(streams, leads(streams, tolerance_s, offset_s), tolerance_s, offset_s)


def _duration(time_s: float) -> str:
    size = abs(time_s)
    for unit, length_s in _UNITS:
        if size >= 2.0 * length_s:
            return f"{size / length_s:.3g} {unit}"
    return f"{size:.3g} s"
