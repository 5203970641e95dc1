# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compare the stamps of the streams with each other and with the clock of their arrival.

The delay of a message is its time of arrival minus its stamp; a stream's delay is the median over
its recent messages, so that single wrong stamps and stalls of the receiver do not count. The
delays of correct streams differ by less than the alignment waits for a stream. The largest group
of streams whose delays agree is taken as correct if it is a majority; if there is none, the
streams whose delay against the receiver's clock is plausible. Each stream's lead is the delay of
that group minus its own: positive if its stamps are ahead.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from itertools import pairwise
from statistics import median
from typing import NamedTuple

from adk_ros.signals.channels import Source

_KEEP = 4096
"""Most messages kept per stream: a second of an IMU at 4 kHz."""
_WINDOW_NS = 1_000_000_000
"""ns of arrivals that count, so that a report shows the present."""
_MIN_COUNT = 5
"""Messages that count even if they are older: streams slower than 5 Hz, a timeout of five periods
in `ros.diagnostics`."""
_JUMP_NS = 1_000_000_000
"""ns by which a step between stamps differs from that between arrivals if the stamps are erratic:
the default deviation from which the alignment holds a stamp for implausible."""
MAX_DELAY_S = 1.0
"""s; delays up to this against the receiver's clock are plausible; the alignment uses no stamps
that deviate by more."""


class StreamStamps(NamedTuple):
    """
    Stamps of one stream over about the last second.

    `delay_s`: median of arrival minus stamp, arrivals in the clock passed to `see`.
    """

    delay_s: float
    is_stuck: bool
    """All stamps are equal."""
    is_erratic: bool
    """More than half of the stamps jump against their arrival, by more than a second."""

    @property
    def is_steady(self) -> bool:
        """Whether the delay describes the stream."""
        return not self.is_stuck and not self.is_erratic


class StampMonitor:
    """Collects stamps and times of arrival, and computes statistics on request."""

    def __init__(self) -> None:
        self._pairs: tuple[deque[tuple[int, int]], ...] = tuple(
            deque(maxlen=_KEEP) for _ in Source
        )

    def see(self, source: Source, stamp_ns: int, arrival_ns: int) -> None:
        """Record a message that arrived at `arrival_ns`, of any clock that does not jump."""
        pairs = self._pairs[source]
        pairs.append((stamp_ns, arrival_ns))
        # The same time of each stream: where a bag is played faster, delays change meanwhile.
        while len(pairs) > _MIN_COUNT and arrival_ns - pairs[0][1] > _WINDOW_NS:
            pairs.popleft()

    def least_delay_ns(self, now_ns: int) -> int | None:
        """
        Return the smallest recent delay of any stream, ns; None before the first message.

        Single stamps that are far ahead of those of their stream do not count.
        """
        delays = []
        for pairs in self._pairs:
            own = [arrival - stamp for stamp, arrival in _recent(list(pairs), now_ns)]
            delays += [delay for delay in own if delay > median(own) - _JUMP_NS]
        return min(delays, default=None)

    def statistics(self, now_ns: int) -> dict[Source, StreamStamps]:
        """Return the statistics at `now_ns`, the clock of the arrivals, by source."""
        return {
            source: _statistics(recent)
            for source in Source
            if (recent := _recent(list(self._pairs[source]), now_ns))
        }


def _recent(pairs: list[tuple[int, int]], now_ns: int) -> list[tuple[int, int]]:
    recent = [pair for pair in pairs if now_ns - pair[1] <= _WINDOW_NS]
    return recent if len(recent) >= _MIN_COUNT else pairs[-_MIN_COUNT:]


def _statistics(pairs: list[tuple[int, int]]) -> StreamStamps:
    steps = [(after[0] - before[0]) - (after[1] - before[1]) for before, after in pairwise(pairs)]
    jumps = sum(abs(step) > _JUMP_NS for step in steps)
    return StreamStamps(
        delay_s=median(arrival - stamp for stamp, arrival in pairs) * 1e-9,
        is_stuck=len(pairs) >= _MIN_COUNT and len({stamp for stamp, _ in pairs}) == 1,
        is_erratic=len(pairs) >= _MIN_COUNT and 2 * jumps > len(steps),
    )


def leads(
    streams: Mapping[Source, StreamStamps], tolerance_s: float, clock_offset_s: float | None
) -> dict[Source, float]:
    """
    Return by how much, s, the stamps of each steady stream are ahead of the correct ones.

    Empty if it cannot be said which streams are correct.

    :param tolerance_s: largest difference of the delays of correct streams, s.
    :param clock_offset_s: receiver's clock minus the clock of the arrivals, s; None: unknown.
    """
    delays = {source: item.delay_s for source, item in streams.items() if item.is_steady}
    correct = _correct(delays, tolerance_s, clock_offset_s)
    if not correct:
        return {}
    reference = median(delays[source] for source in correct)
    return {source: reference - delay for source, delay in delays.items()}


def _correct(
    delays: Mapping[Source, float], tolerance_s: float, clock_offset_s: float | None
) -> list[Source]:
    groups = [
        [other for other in delays if abs(delays[other] - delay) <= tolerance_s]
        for delay in delays.values()
    ]
    largest: list[Source] = max(groups, key=len, default=[])
    if len(largest) > 0.5 * len(delays) and len(delays) > 1:
        return largest
    if clock_offset_s is None:
        return []
    return [
        source
        for source, delay in delays.items()
        if -tolerance_s <= delay + clock_offset_s <= MAX_DELAY_S
    ]
