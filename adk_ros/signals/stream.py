# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The recent past of one stream, and what it says of an instant that lies at or after its readings.

An instant's value is the end point of a least-squares line through the readings of a short
window: unlike the last value held, it does not lag, and unlike a difference of two readings it
does not amplify noise (five readings: 0.6 of one reading's variance).
"""

from __future__ import annotations

from bisect import bisect_right
from typing import NamedTuple

from adk_ros.signals.channels import TICK_NS

_KEEP_NS = 500_000_000
_MAX_EXTRAPOLATION = 1.5
_PERIOD_GAIN = 0.1
_SHORTEST_PERIOD_NS = 1e6
_HOLD_LAST_WEIGHTS = [1.0]


class StreamSnapshot(NamedTuple):
    """
    A reading, and how its stream stood when it was the newest one.

    What came after it has no part in this: a sample must not depend on how many later readings
    happened to arrive before it was given out.
    """

    stamp_ns: int
    values: tuple[float, ...]
    period_ns: float
    repeats: int
    """How many readings before this one said the same to the last bit."""
    unchanged_since_ns: int

    def unchanged_s(self) -> float:
        """Seconds for which the stream has said the same to the last bit."""
        return (self.stamp_ns - self.unchanged_since_ns) * 1e-9


class SampledStream:
    """
    Readings of the last half second, sorted by stamp, and the period they come at.

    `period_ns` is learned from the stamps themselves, so a rate that changes half-way is followed;
    it is 0 until two readings are known.
    """

    def __init__(self) -> None:
        self.stamps: list[int] = []
        self._values: list[tuple[float, ...]] = []
        self._standing: list[tuple[float, int, int]] = []
        self.period_ns = 0.0
        self.awaited = True

    @property
    def last_ns(self) -> int:
        """Stamp of the newest reading; only meaningful where there is one."""
        return self.stamps[-1]

    def __bool__(self) -> bool:
        return bool(self.stamps)

    def has(self, stamp_ns: int) -> bool:
        """Whether a reading with just this stamp is known."""
        index = bisect_right(self.stamps, stamp_ns)
        return index > 0 and self.stamps[index - 1] == stamp_ns

    def add(self, stamp_ns: int, values: tuple[float, ...]) -> None:
        """Insert a reading in its place; the caller has checked that its stamp is new."""
        stamps = self.stamps
        if stamps and stamp_ns < stamps[-1]:
            place = bisect_right(stamps, stamp_ns)
            standing = (self._standing[max(place - 1, 0)][0], 0, stamp_ns)
            stamps.insert(place, stamp_ns)
            self._values.insert(place, values)
            self._standing.insert(place, standing)
            return
        standing = (0.0, 0, stamp_ns)
        if stamps:
            self._learn_period(stamp_ns - stamps[-1])
            if values == self._values[-1]:
                _, repeats, since_ns = self._standing[-1]
                standing = (self.period_ns, repeats + 1, since_ns)
            else:
                standing = (self.period_ns, 0, stamp_ns)
        stamps.append(stamp_ns)
        self._values.append(values)
        self._standing.append(standing)
        if stamp_ns - stamps[0] > 2 * _KEEP_NS:
            # One older than that is kept: it is what held until the oldest of the others.
            drop = min(bisect_right(stamps, stamp_ns - _KEEP_NS), len(stamps)) - 1
            del stamps[:drop]
            del self._values[:drop]
            del self._standing[:drop]

    def _learn_period(self, gap_ns: int) -> None:
        if self.period_ns == 0.0:
            # Not less, else two readings that come at once at the start are slow to be outgrown.
            self.period_ns = max(float(gap_ns), _SHORTEST_PERIOD_NS)
            return
        # A lost message must not double the period; a new rate gets through within some readings.
        bounded = min(float(gap_ns), 3.0 * self.period_ns)
        self.period_ns += _PERIOD_GAIN * (bounded - self.period_ns)

    def at_or_before(self, stamp_ns: int) -> StreamSnapshot | None:
        """Newest reading stamped at or before `stamp_ns`, or None."""
        index = bisect_right(self.stamps, stamp_ns) - 1
        if index < 0:
            return None
        return StreamSnapshot(self.stamps[index], self._values[index], *self._standing[index])

    def extrapolate(self, stamp_ns: int) -> tuple[float, ...] | None:
        """
        Value at `stamp_ns` of the line fitted to the window before it, per channel; None if empty.

        The window is a tick long, and never holds fewer than about three readings. Beyond one and
        a half periods after the newest reading the line is no longer followed.
        """
        end = bisect_right(self.stamps, stamp_ns)
        if end == 0:
            return None
        weights = self._extrapolation_weights(stamp_ns, end)
        columns = zip(*self._values[end - len(weights) : end], strict=True)
        return tuple([sum(map(float.__mul__, weights, column)) for column in columns])

    def extrapolation_of(self, channel: int, stamp_ns: int) -> float | None:
        """Return one channel of `line`; None if empty."""
        end = bisect_right(self.stamps, stamp_ns)
        if end == 0:
            return None
        weights = self._extrapolation_weights(stamp_ns, end)
        values = self._values
        if len(weights) == 1:
            return values[end - 1][channel]
        total, index = 0.0, end - len(weights)
        for weight in weights:
            total += weight * values[index][channel]
            index += 1
        return total

    def _extrapolation_weights(self, stamp_ns: int, end: int) -> list[float]:
        """Weights of the last readings before index `end` in the line's value at `stamp_ns`."""
        stamps = self.stamps
        newest, period_ns = stamps[end - 1], self._standing[end - 1][0]
        window_ns = max(TICK_NS, int(2.5 * period_ns))
        start = bisect_right(stamps, newest - window_ns, 0, end)
        count = end - start
        # Readings at nearly the same instant say nothing of a slope.
        if count < 2 or newest - stamps[start] < 0.5 * period_ns:
            return _HOLD_LAST_WEIGHTS
        reach = min(stamp_ns, newest + int(_MAX_EXTRAPOLATION * period_ns))
        times = [(stamp - reach) * 1e-9 for stamp in stamps[start:end]]
        mean_t = sum(times) / count
        spread = sum([t * t for t in times]) - count * mean_t * mean_t
        if spread <= 0.0:
            return _HOLD_LAST_WEIGHTS
        level, lean = 1.0 / count, mean_t / spread
        return [level - (t - mean_t) * lean for t in times]

    def mean(self, after_ns: int, until_ns: int) -> tuple[float, ...] | None:
        """Mean of the readings in (after, until], else the newest at or before; None if empty."""
        end = bisect_right(self.stamps, until_ns)
        if end == 0:
            return None
        start = min(bisect_right(self.stamps, after_ns, 0, end), end - 1)
        if end - start == 1:
            return self._values[start]
        share = 1.0 / (end - start)
        columns = zip(*self._values[start:end], strict=True)
        return tuple([sum(column) * share for column in columns])
