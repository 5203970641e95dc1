# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Readings of three or four streams that are not in step -> samples on the causal 25 ms grid.

The grid is header time: tick t_k = k * 25 ms. A sample at t_k holds what readings stamped at or
before t_k say, so it depends on the set of those readings and not on the order in which they
came; the live node and a replay of its bag therefore see the same samples. Tick t_k is given out
as soon as

* some stream has a reading stamped at or after t_k (time has got there), and
* no other stream is about to deliver a reading that belongs to it: one is waited for only if
  0.8 of its period has gone by at t_k since its last reading, and never for longer than
  `max_wait_s` of the other streams' time. A stream that lets itself be waited for in vain though
  1.2 of its period have gone by is not waited for again until it is back.

State at t_k: yaw rate from the gyro (else from odometry) by `Stream.line`; velocities from the
last odometry reading, carried to t_k by the accelerometer,
    dv_x = (a_x + r v_y) dt,  dv_y = (a_y - r v_x) dt,
else by `Stream.line`. The command is the last one: commands are held until the next. A
measured road-wheel angle, if there is such a stream, takes the place of the commanded one.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable

from adk_ros.signals.channels import TICK_NS, Flag, Reading, Sample
from adk_ros.signals.clock import ClockGuard, StampVerdict
from adk_ros.signals.stream import SampledStream, StreamSnapshot

_PERIODS_UNTIL_STALE = 3.0
_AWAITED_FROM, _OVERDUE_FROM = 0.8, 1.2
# Plain integers: operations on flags themselves cost a microsecond each.
_NO_IMU, _IMU_STALE, _ODOMETRY_STALE = (
    int(Flag.NO_IMU),
    int(Flag.IMU_STALE),
    int(Flag.ODOMETRY_STALE),
)
_COMMAND_STALE, _FROZEN = int(Flag.COMMAND_STALE), int(Flag.FROZEN)
_COASTING, _RESTART = int(Flag.COASTING), int(Flag.RESTART)
_NAN2 = (math.nan, math.nan)
_NAN3 = (math.nan, math.nan, math.nan)


class Aligner:
    """
    Folds readings into samples; the same object serves one message at a time and whole bags.

    `counts` tells what was not used and why: "duplicate", "stray stamp"; what was used, but not
    when it should have been: "out of order", "late" (a tick it belongs to was out already); and
    each "clock jump".

    :param odometry_timeout_s: odometry older than this no longer yields a state (COASTING).
    :param frozen_after_s: a moving vehicle's sensor that repeats itself for so long is frozen.
    :param max_wait_s: see above.
    """

    def __init__(
        self,
        odometry_timeout_s: float = 0.5,
        frozen_after_s: float = 1.0,
        max_wait_s: float = 0.05,
        jump_s: float = 1.0,
    ) -> None:
        self._timeout_ns = round(odometry_timeout_s * 1e9)
        self._frozen_after_s = frozen_after_s
        self._max_wait_ns = round(max_wait_s * 1e9)
        self._guard = ClockGuard(jump_s)
        self.counts: Counter[str] = Counter()
        self._begin()

    def _begin(self) -> None:
        self.streams = (SampledStream(), SampledStream(), SampledStream(), SampledStream())
        self._tick_ns: int | None = None
        self._restarted = True

    @property
    def newest_ns(self) -> int | None:
        """Newest believed stamp of any stream."""
        return self._guard.newest_ns

    def reset(self) -> None:
        """Forget everything but the counts."""
        self._guard.reset()
        self._begin()

    def push(self, reading: Reading) -> list[Sample]:
        """Take one reading; return the samples that have become complete, oldest first."""
        if self._guard.follows(reading.stamp_ns):
            # Nearly every reading, so this way is kept short.
            self._insert(reading)
            tick_ns, newest = self._tick_ns, self._guard.newest_ns
            if tick_ns is not None and newest is not None and newest < tick_ns:
                return []
            return self._complete()
        verdict, others = self._guard.check_stamp(reading)
        if verdict is not StampVerdict.JUMP:
            if others:
                self.counts["stray stamp"] += len(others)
            if verdict is StampVerdict.HOLD:
                return []
            self._insert(reading)
            return self._complete()
        self.counts["clock jump"] += 1
        self._begin()
        for freed in others:
            self._insert(freed)
        return self._complete()

    def advance(self, now_ns: int) -> list[Sample]:
        """
        Let time pass without a reading, for streams too slow to show that a tick is due.

        `now_ns` is the caller's clock less what messages may still be under way. It counts only
        while it is within a second of the stamps: another clock says nothing about this grid.
        """
        newest = self._guard.newest_ns
        if newest is None or not 0 < now_ns - newest < 1_000_000_000:
            return []
        return self._complete(now_ns)

    def _insert(self, reading: Reading) -> None:
        stream = self.streams[reading.source]
        stamp_ns = reading.stamp_ns
        if stream.stamps:
            if stamp_ns <= stream.stamps[-1]:
                if stream.has(stamp_ns):
                    self.counts["duplicate"] += 1
                    return
                self.counts["out of order"] += 1
            if self._tick_ns is not None and stamp_ns <= self._tick_ns - TICK_NS:
                self.counts["late"] += 1
        stream.add(stamp_ns, reading.values)
        stream.awaited = True

    def _complete(self, now_ns: int | None = None) -> list[Sample]:
        newest = self._guard.newest_ns
        _, odometry, command, _ = self.streams
        if newest is None or not odometry.stamps or not command.stamps:
            return []
        reached = newest if now_ns is None else max(newest, now_ns)
        if self._tick_ns is None:
            first = max(odometry.stamps[0], command.stamps[0])
            self._tick_ns = -(-first // TICK_NS) * TICK_NS
        samples = []
        while self._tick_ns <= reached and self._settled(self._tick_ns, reached):
            samples.append(self._sample(self._tick_ns))
            self._tick_ns += TICK_NS
            self._restarted = False
        return samples

    def _settled(self, tick_ns: int, reached_ns: int) -> bool:
        for stream in self.streams:
            stamps = stream.stamps
            if not stamps or not stream.awaited or stamps[-1] >= tick_ns:
                continue
            age_ns = tick_ns - stamps[-1]
            if age_ns < _AWAITED_FROM * stream.period_ns:
                continue
            if reached_ns - tick_ns < self._max_wait_ns:
                return False
            # Until then it may still be in time for the next tick.
            stream.awaited = age_ns < _OVERDUE_FROM * stream.period_ns
        return True

    def _fresh(self, known: StreamSnapshot, tick_ns: int) -> bool:
        allowed = max(_PERIODS_UNTIL_STALE * known.period_ns, 2.0 * TICK_NS)
        return tick_ns - known.stamp_ns <= allowed

    def _frozen(self, known: StreamSnapshot) -> bool:
        return (
            self._frozen_after_s > 0.0
            and known.repeats >= 5
            and known.unchanged_s() >= self._frozen_after_s
        )

    def _sample(self, tick_ns: int) -> Sample:
        imu, odometry, command, steering = self.streams
        flags = _RESTART if self._restarted else 0
        moved = odometry.at_or_before(tick_ns)
        held = command.at_or_before(tick_ns)
        # The grid starts after the first of both, but a late insertion may precede nothing.
        u = (held.values[0], held.values[1]) if held else _NAN2
        if held is None or not self._fresh(held, tick_ns):
            flags |= _COMMAND_STALE
        steered = steering.at_or_before(tick_ns) if steering else None
        if steered is not None:
            u = (u[0], steered.values[0])
            if not self._fresh(steered, tick_ns):
                flags |= _COMMAND_STALE

        a, gyro = _NAN2, None
        sensed = imu.at_or_before(tick_ns) if imu else None
        if sensed is None:
            flags |= _NO_IMU
        elif not self._fresh(sensed, tick_ns):
            flags |= _IMU_STALE
        elif self._frozen(sensed) and moved is not None and abs(moved.values[0]) > 1.0:
            flags |= _FROZEN
        else:
            gyro = imu.extrapolation_of(2, tick_ns)
            mean = imu.mean(tick_ns - TICK_NS, tick_ns)
            assert mean is not None
            a = (mean[0], mean[1])

        if moved is None:
            return Sample(tick_ns, _NAN3, u, a, flags | _ODOMETRY_STALE | _COASTING)
        if not self._fresh(moved, tick_ns):
            flags |= _ODOMETRY_STALE
        if self._frozen(moved) and abs(moved.values[0]) > 1.0:
            return Sample(tick_ns, _NAN3, u, a, flags | _FROZEN | _COASTING)
        if tick_ns - moved.stamp_ns > self._timeout_ns:
            return Sample(tick_ns, _NAN3, u, a, flags | _COASTING)
        x = self._state(tick_ns, moved, gyro, a)
        if not math.isfinite(x[0] + x[1] + x[2]):
            return Sample(tick_ns, _NAN3, u, a, flags | _COASTING)
        return Sample(tick_ns, x, u, a, flags)

    def _state(
        self,
        tick_ns: int,
        moved: StreamSnapshot,
        gyro: float | None,
        a: tuple[float, float],
    ) -> tuple[float, float, float]:
        imu, odometry = self.streams[:2]
        if gyro is None or not math.isfinite(a[0]):
            line = odometry.extrapolate(tick_ns)
            assert line is not None
            return line[0], line[1], line[2] if gyro is None else gyro
        v_x, v_y, _rate = moved.values
        elapsed_s = (tick_ns - moved.stamp_ns) * 1e-9
        if elapsed_s > 0.0:
            mean = imu.mean(moved.stamp_ns, tick_ns)
            assert mean is not None
            # The turn's rate over the same time as the force: in a swerve the difference counts.
            v_x, v_y = (
                v_x + (mean[0] + mean[2] * v_y) * elapsed_s,
                v_y + (mean[1] - mean[2] * v_x) * elapsed_s,
            )
        return v_x, v_y, gyro


def align_samples(readings: Iterable[Reading], aligner: Aligner | None = None) -> list[Sample]:
    """Fold `readings` (in order of arrival) through one aligner."""
    aligner = aligner or Aligner()
    samples: list[Sample] = []
    for reading in readings:
        samples.extend(aligner.push(reading))
    return samples
