# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Recent readings of one stream, and extrapolation to an instant at or after its readings.

The value at an instant is the end point of a least-squares line through the readings of a short
window. Unlike holding the last value it has no lag, and unlike a difference of two readings it
does not amplify noise (five readings: 0.6 of the variance of one reading).
"""

from __future__ import annotations

from bisect import bisect_right
from operator import attrgetter
from typing import NamedTuple

from adk_ros.signals.channels import TICK_NS, Reading

KEEP_NS = 500_000_000
"""ns of readings kept at least: the default odometry timeout, beyond which no sample uses them."""
_MAX_EXTRAPOLATION = 1.5
"""Periods beyond the newest reading up to which the line is extrapolated: one lost message."""
_PERIOD_GAIN = 0.1
"""Gain of the period estimate per reading: a new rate is adopted within about ten readings."""
_MAX_PERIOD_RATIO = 3.0
"""Gaps count as at most this many periods, so that a lost message does not double the period."""
_MIN_PERIOD_NS = 1e6
"""ns; smallest first estimate: two readings at almost the same time are outgrown too slowly."""
_WINDOW_PERIODS = 2.5
"""Periods in the window of a slow stream: three readings."""
_MIN_SPAN_PERIODS = 0.5
"""Periods that the readings in the window must span to determine a slope."""
_stamp_of = attrgetter("stamp_ns")
_HOLD_LAST_WEIGHTS = [1.0]
"""Weights that hold the last reading."""


class StreamSnapshot(NamedTuple):
    """
    A reading, and the state of its stream when it was the newest one.

    Later readings have no influence: a sample must not depend on how many of them arrived before
    it was emitted.
    """

    stamp_ns: int
    values: tuple[float, ...]
    period_ns: float
    repeats: int
    """Number of preceding readings with bit-identical values."""
    unchanged_since_ns: int

    def unchanged_s(self) -> float:
        """Return the time for which the values have been bit-identical, s."""
        return (self.stamp_ns - self.unchanged_since_ns) * 1e-9


class SampledStream:
    """
    Readings of the last half second, or of `keep_ns`, sorted by stamp, and their period.

    `period_ns` is estimated from the stamps, so changes of the rate are followed; it is 0 until
    two readings are known.
    """

    def __init__(self, keep_ns: int = KEEP_NS) -> None:
        self._keep_ns = keep_ns
        self.stamps: list[int] = []
        self._values: list[tuple[float, ...]] = []
        self._states: list[tuple[float, int, int]] = []
        self.unjudged: list[Reading] = []
        """Readings that the gate has not seen yet; used only if there is one."""
        self.period_ns = 0.0
        self.awaited = True

    @property
    def last_ns(self) -> int:
        """Stamp of the newest reading; requires at least one."""
        return self.stamps[-1]

    def __bool__(self) -> bool:
        return bool(self.stamps)

    def has(self, stamp_ns: int) -> bool:
        """Return whether a reading has exactly this stamp."""
        index = bisect_right(self.stamps, stamp_ns)
        return index > 0 and self.stamps[index - 1] == stamp_ns

    def add(self, stamp_ns: int, values: tuple[float, ...]) -> None:
        """Insert a reading by its stamp, which must be new."""
        stamps = self.stamps
        if stamps and stamp_ns < stamps[-1]:
            place = bisect_right(stamps, stamp_ns)
            state = (self._states[max(place - 1, 0)][0], 0, stamp_ns)
            stamps.insert(place, stamp_ns)
            self._values.insert(place, values)
            self._states.insert(place, state)
            return
        state = (0.0, 0, stamp_ns)
        if stamps:
            self._update_period(stamp_ns - stamps[-1])
            if values == self._values[-1]:
                _, repeats, since_ns = self._states[-1]
                state = (self.period_ns, repeats + 1, since_ns)
            else:
                state = (self.period_ns, 0, stamp_ns)
        stamps.append(stamp_ns)
        self._values.append(values)
        self._states.append(state)
        if stamp_ns - stamps[0] > 2 * self._keep_ns:
            # One older reading is kept: its value holds until the next one.
            drop = min(bisect_right(stamps, stamp_ns - self._keep_ns), len(stamps)) - 1
            del stamps[:drop]
            del self._values[:drop]
            del self._states[:drop]
            self.unjudged = [r for r in self.unjudged if r.stamp_ns >= stamps[0]]

    def take_unjudged(self, until_ns: int) -> list[Reading]:
        """Return the unjudged readings stamped until `until_ns`, by stamp, and forget them."""
        unjudged = self.unjudged
        due = [reading for reading in unjudged if reading.stamp_ns <= until_ns]
        if len(due) == len(unjudged):
            self.unjudged = []
        else:
            self.unjudged = [reading for reading in unjudged if reading.stamp_ns > until_ns]
        if len(due) > 1:
            due.sort(key=_stamp_of)
        return due

    def remove(self, stamp_ns: int) -> None:
        """Remove the reading with this stamp, if it is still kept."""
        if not self.has(stamp_ns):
            return
        index = bisect_right(self.stamps, stamp_ns) - 1
        del self.stamps[index]
        del self._values[index]
        del self._states[index]

    def _update_period(self, gap_ns: int) -> None:
        if self.period_ns == 0.0:
            self.period_ns = max(float(gap_ns), _MIN_PERIOD_NS)
            return
        bounded = min(float(gap_ns), _MAX_PERIOD_RATIO * self.period_ns)
        self.period_ns += _PERIOD_GAIN * (bounded - self.period_ns)

    def at_or_before(self, stamp_ns: int) -> StreamSnapshot | None:
        """Return the newest reading stamped at or before `stamp_ns`, or None."""
        index = bisect_right(self.stamps, stamp_ns) - 1
        if index < 0:
            return None
        return StreamSnapshot(self.stamps[index], self._values[index], *self._states[index])

    def extrapolate(self, stamp_ns: int) -> tuple[float, ...] | None:
        """
        Return the value at `stamp_ns` of the line fitted to the window before it, per channel.

        The window is one tick long, but at least 2.5 periods. The line is extrapolated by at most
        1.5 periods beyond the newest reading. None without a reading.
        """
        end = bisect_right(self.stamps, stamp_ns)
        if end == 0:
            return None
        weights = self._extrapolation_weights(stamp_ns, end)
        columns = zip(*self._values[end - len(weights) : end], strict=True)
        return tuple([sum(map(float.__mul__, weights, column)) for column in columns])

    def extrapolation_of(self, channel: int, stamp_ns: int) -> float | None:
        """Return one channel of `extrapolate`; None without a reading."""
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
        """Return the weights of the readings before index `end` in the value at `stamp_ns`."""
        stamps = self.stamps
        newest, period_ns = stamps[end - 1], self._states[end - 1][0]
        window_ns = max(TICK_NS, int(_WINDOW_PERIODS * period_ns))
        start = bisect_right(stamps, newest - window_ns, 0, end)
        count = end - start
        # Readings at nearly the same instant determine no slope.
        if count < 2 or newest - stamps[start] < _MIN_SPAN_PERIODS * period_ns:
            return _HOLD_LAST_WEIGHTS
        target_ns = min(stamp_ns, newest + int(_MAX_EXTRAPOLATION * period_ns))
        times = [(stamp - target_ns) * 1e-9 for stamp in stamps[start:end]]
        mean_t = sum(times) / count
        spread = sum([t * t for t in times]) - count * mean_t * mean_t
        if spread <= 0.0:
            return _HOLD_LAST_WEIGHTS
        level, slope = 1.0 / count, mean_t / spread
        return [level - (t - mean_t) * slope for t in times]

    def mean(self, after_ns: int, until_ns: int) -> tuple[float, ...] | None:
        """Return the mean of the readings in (after, until], else the newest before, else None."""
        end = bisect_right(self.stamps, until_ns)
        if end == 0:
            return None
        start = min(bisect_right(self.stamps, after_ns, 0, end), end - 1)
        if end - start == 1:
            return self._values[start]
        weight = 1.0 / (end - start)
        columns = zip(*self._values[start:end], strict=True)
        return tuple([sum(column) * weight for column in columns])
