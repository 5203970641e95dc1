# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Align readings of three or four unsynchronised streams to samples on a causal 25 ms grid.

The grid is in header time: tick t_k = k * 25 ms. The sample at t_k uses only readings stamped at
or before t_k, so it depends on the set of those readings and not on their order of arrival. The
live node and a replay of its bag therefore produce identical samples. The sample at t_k is
emitted as soon as

* some stream has a reading stamped at or after t_k, and
* no other stream is due to deliver a reading for it. A stream is due if at t_k at least 0.8 of
  its period has passed since its last reading. It is waited for no longer than `max_wait_s` of
  the other streams' time. A stream that was waited for in vain although 1.2 of its period have
  passed is not waited for again until it delivers.

State at t_k: yaw rate from the gyro (else from odometry) by `SampledStream.extrapolate`;
velocities from the last odometry reading, integrated to t_k with the accelerometer,
    dv_x = (a_x + r v_y) dt,  dv_y = (a_y - r v_x) dt,
else by `SampledStream.extrapolate`. Commands are held until the next one (zero-order hold). A
measured road-wheel angle, if there is such a stream, replaces the commanded one while it is fresh.

With a gate (`signals.gate`), the readings of IMU and odometry are judged when the first sample
that may use them is formed, in order of their stamps, and rejected ones are removed. What is
judged thus depends on the set of readings only, too.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator

from adk_ros.signals.channels import TICK_NS, Flag, Reading, Sample, Source
from adk_ros.signals.clock import ClockGuard, StampVerdict
from adk_ros.signals.gate import ReadingGate
from adk_ros.signals.stream import KEEP_NS, SampledStream, StreamSnapshot

_PERIODS_UNTIL_STALE = 3.0
"""Periods of a stream without a reading after which it is stale: two lost messages are not."""

_DUE_AFTER, _OVERDUE_AFTER = 0.8, 1.2
"""Shares of a stream's period since its last reading from which its next one is due, or overdue.

Allows 20 % of jitter in the stamps."""

_MIN_FROZEN_REPEATS = 5
"""Repetitions below which a sensor is not frozen: quantised values may repeat by chance."""

_MOVING_SPEED = 1.0
"""m/s above which a sensor's values must change; a standing vehicle's sensors may repeat."""

_MAX_CLOCK_LEAD_NS = 1_000_000_000
"""ns by which the caller's clock may lead the stamps; beyond, it is another time base."""

_EULER_S = 0.05
"""s since odometry up to which one step of Euler's suffices: at 1 m/s² and 1 rad/s, 1 mm/s off."""

_SMALL_ANGLE = 1e-6
"""rad below which a turn is straight."""

# Plain integers: operations on the flags themselves take a microsecond each.
_NO_IMU, _IMU_STALE, _ODOMETRY_STALE = (
    int(Flag.NO_IMU),
    int(Flag.IMU_STALE),
    int(Flag.ODOMETRY_STALE),
)
_COMMAND_STALE, _FROZEN = int(Flag.COMMAND_STALE), int(Flag.FROZEN)
_COASTING, _RESTART = int(Flag.COASTING), int(Flag.RESTART)
_REJECTED, _LEVEL_CHANGE = int(Flag.REJECTED), int(Flag.LEVEL_CHANGE)
_ODOMETRY = Source.ODOMETRY
_NAN2 = (math.nan, math.nan)
_NAN3 = (math.nan, math.nan, math.nan)


class Aligner:
    """
    Converts readings, in order of arrival, to samples, both online and for whole bags.

    `counts` counts unused readings: "duplicate", "stray stamp"; readings that arrived too late or
    in the wrong order: "out of order", "late" (after its sample was emitted); and "clock jump".
    `counts_by_source` counts the unused and the late ones by (kind, source).

    :param odometry_timeout_s: age beyond which odometry yields no state (COASTING), s.
    :param frozen_after_s: time after which a sensor that repeats the same value while the vehicle
        moves is frozen, s; 0: never.
    :param max_wait_s: longest wait for a stream that is due, s, see above.
    :param jump_s: deviation of a stamp from the newest one that is implausible, s.
    :param gate: judges the readings; the caller tells it each prediction.
    """

    def __init__(
        self,
        odometry_timeout_s: float = 0.5,
        frozen_after_s: float = 1.0,
        max_wait_s: float = 0.05,
        jump_s: float = 1.0,
        gate: ReadingGate | None = None,
    ) -> None:
        self._gate = gate
        self._timeout_ns = round(odometry_timeout_s * 1e9)
        self._frozen_after_s = frozen_after_s
        self._max_wait_ns = round(max_wait_s * 1e9)
        self._guard = ClockGuard(jump_s)
        self.counts: Counter[str] = Counter()
        self.counts_by_source: Counter[tuple[str, Source]] = Counter()
        self._begin()

    def _begin(self) -> None:
        # The force since the last odometry is needed until odometry is too old.
        imu = SampledStream(max(KEEP_NS, self._timeout_ns))
        self.streams = (imu, SampledStream(), SampledStream(), SampledStream())
        self._tick_ns: int | None = None
        self._restarted = True
        self._had_stopped = False
        if self._gate is not None:
            self._gate.forget()

    @property
    def newest_ns(self) -> int | None:
        """Newest accepted stamp of any stream."""
        return self._guard.newest_ns

    def reset(self) -> None:
        """Discard all readings; keep the counts."""
        self._guard.reset()
        self._begin()

    def push(self, reading: Reading) -> list[Sample]:
        """Process one reading; return the samples that it completes, oldest first."""
        return list(self.take(reading))

    def take(self, reading: Reading) -> Iterable[Sample]:
        """
        Process one reading; return the samples that it completes, oldest first, to iterate once.

        Each is formed when it is asked for, so that the gate knows the prediction from the one
        before. All of them must be taken before the next call.
        """
        if self._guard.follows(reading):
            # Fast path: nearly every reading.
            self._insert(reading)
            tick_ns, newest = self._tick_ns, self._guard.newest_ns
            if tick_ns is not None and newest is not None and newest < tick_ns:
                return ()
            return self._complete()
        verdict, released = self._guard.check_stamp(reading)
        if verdict is not StampVerdict.JUMP:
            if released:
                self.counts["stray stamp"] += len(released)
                self.counts_by_source.update(("stray stamp", item.source) for item in released)
            if verdict is StampVerdict.HOLD:
                return ()
            self._insert(reading)
            return self._complete()
        self.counts["clock jump"] += 1
        self._begin()
        for item in released:
            self._insert(item)
        return self._complete()

    def advance(self, now_ns: int) -> Iterable[Sample]:
        """
        Complete samples by the clock, for streams too slow to complete them in time; as `take`.

        `now_ns` is the caller's clock minus the transit time of messages. It is used only while
        it leads the stamps by less than 1 s; otherwise it has another time base.
        """
        newest = self._guard.newest_ns
        if newest is None or not 0 < now_ns - newest < _MAX_CLOCK_LEAD_NS:
            return ()
        return self._complete(now_ns)

    def _insert(self, reading: Reading) -> None:
        stream = self.streams[reading.source]
        stamp_ns = reading.stamp_ns
        if stream.stamps:
            if stamp_ns <= stream.stamps[-1]:
                if stream.has(stamp_ns):
                    self.counts["duplicate"] += 1
                    self.counts_by_source["duplicate", reading.source] += 1
                    return
                self.counts["out of order"] += 1
            if self._tick_ns is not None and stamp_ns <= self._tick_ns - TICK_NS:
                self.counts["late"] += 1
                self.counts_by_source["late", reading.source] += 1
        stream.add(stamp_ns, reading.values)
        stream.awaited = True
        if self._gate is not None and reading.source <= _ODOMETRY:
            stream.unjudged.append(reading)

    def _complete(self, now_ns: int | None = None) -> Iterator[Sample]:
        newest = self._guard.newest_ns
        _, odometry, command, _ = self.streams
        if newest is None or not odometry.stamps or not command.stamps:
            return
        reached = newest if now_ns is None else max(newest, now_ns)
        if self._tick_ns is None:
            first = max(odometry.stamps[0], command.stamps[0])
            self._tick_ns = -(-first // TICK_NS) * TICK_NS
        while self._tick_ns <= reached and self._is_complete(self._tick_ns, reached):
            tick_ns, flags = self._tick_ns, _RESTART if self._restarted else 0
            self._tick_ns += TICK_NS
            self._restarted = False
            if self._gate is not None:
                flags |= self._judge(self._gate, tick_ns)
            yield self._sample(tick_ns, flags)

    def _judge(self, gate: ReadingGate, tick_ns: int) -> int:
        """Remove the readings up to a tick that the gate rejects; return the flags."""
        flags = 0
        imu, odometry, _, _ = self.streams
        for reading in gate.rejects(imu.take_unjudged(tick_ns) + odometry.take_unjudged(tick_ns)):
            self.streams[reading.source].remove(reading.stamp_ns)
            flags |= _REJECTED
            if reading.source is _ODOMETRY:
                flags |= _ODOMETRY_STALE
        return flags | _LEVEL_CHANGE if gate.level_changed else flags

    def _is_complete(self, tick_ns: int, reached_ns: int) -> bool:
        for stream in self.streams:
            stamps = stream.stamps
            if not stamps or not stream.awaited or stamps[-1] >= tick_ns:
                continue
            age_ns = tick_ns - stamps[-1]
            if age_ns < _DUE_AFTER * stream.period_ns:
                continue
            if reached_ns - tick_ns < self._max_wait_ns:
                return False
            # Until it is overdue, its reading may still be in time for the next tick.
            stream.awaited = age_ns < _OVERDUE_AFTER * stream.period_ns
        return True

    def _is_fresh(self, known: StreamSnapshot, tick_ns: int) -> bool:
        allowed = max(_PERIODS_UNTIL_STALE * known.period_ns, 2.0 * TICK_NS)
        return tick_ns - known.stamp_ns <= allowed

    def _is_frozen(self, known: StreamSnapshot) -> bool:
        return (
            self._frozen_after_s > 0.0
            and known.repeats >= _MIN_FROZEN_REPEATS
            and known.unchanged_s() >= self._frozen_after_s
        )

    def _sample(self, tick_ns: int, flags: int) -> Sample:
        imu, odometry, command, steering = self.streams
        odometry_at = odometry.at_or_before(tick_ns)
        command_at = command.at_or_before(tick_ns)
        # None if the stream's readings up to this tick were dropped or arrived late.
        u = (command_at.values[0], command_at.values[1]) if command_at else _NAN2
        if command_at is None or not self._is_fresh(command_at, tick_ns):
            flags |= _COMMAND_STALE
        steering_at = steering.at_or_before(tick_ns) if steering else None
        if steering_at is not None:
            if self._is_fresh(steering_at, tick_ns):
                u = (u[0], steering_at.values[0])
            elif tick_ns - steering_at.stamp_ns <= self._timeout_ns:
                flags |= _COMMAND_STALE

        a, gyro = _NAN2, None
        imu_at = imu.at_or_before(tick_ns) if imu else None
        if imu_at is None or tick_ns - imu_at.stamp_ns > self._timeout_ns:
            # One that has stopped is as none: what is learned from odometry is right again.
            flags |= _NO_IMU
            self._had_stopped = imu_at is not None
        elif not self._is_fresh(imu_at, tick_ns):
            flags |= _IMU_STALE
        elif (
            self._is_frozen(imu_at)
            and odometry_at is not None
            and abs(odometry_at.values[0]) > _MOVING_SPEED
        ):
            flags |= _FROZEN
        else:
            if self._had_stopped:
                # Its yaw rate is not a continuation of odometry's.
                flags |= _IMU_STALE
                self._had_stopped = False
            gyro = imu.extrapolation_of(2, tick_ns)
            mean = imu.mean(tick_ns - TICK_NS, tick_ns)
            assert mean is not None
            a = (mean[0], mean[1])

        if odometry_at is None:
            return Sample(tick_ns, _NAN3, u, a, flags | _ODOMETRY_STALE | _COASTING)
        if not self._is_fresh(odometry_at, tick_ns):
            flags |= _ODOMETRY_STALE
        if self._is_frozen(odometry_at) and abs(odometry_at.values[0]) > _MOVING_SPEED:
            return Sample(tick_ns, _NAN3, u, a, flags | _FROZEN | _COASTING)
        if tick_ns - odometry_at.stamp_ns > self._timeout_ns:
            return Sample(tick_ns, _NAN3, u, a, flags | _COASTING)
        x = self._state(tick_ns, odometry_at, gyro, a)
        if not math.isfinite(x[0] + x[1] + x[2]):
            return Sample(tick_ns, _NAN3, u, a, flags | _COASTING)
        return Sample(tick_ns, x, u, a, flags)

    def _state(
        self,
        tick_ns: int,
        odometry_at: StreamSnapshot,
        gyro: float | None,
        a: tuple[float, float],
    ) -> tuple[float, float, float]:
        imu, odometry = self.streams[:2]
        if gyro is None or not math.isfinite(a[0]):
            state = odometry.extrapolate(tick_ns)
            assert state is not None
            return state[0], state[1], state[2] if gyro is None else gyro
        v_x, v_y, _rate = odometry_at.values
        elapsed_s = (tick_ns - odometry_at.stamp_ns) * 1e-9
        if elapsed_s > 0.0:
            mean = imu.mean(odometry_at.stamp_ns, tick_ns)
            assert mean is not None
            # Mean yaw rate over the same interval as the force, which matters in fast manoeuvres.
            if elapsed_s > _EULER_S:
                v_x, v_y = _carried_on(v_x, v_y, mean, elapsed_s)
            else:
                v_x, v_y = (
                    v_x + (mean[0] + mean[2] * v_y) * elapsed_s,
                    v_y + (mean[1] - mean[2] * v_x) * elapsed_s,
                )
        return v_x, v_y, gyro


def _carried_on(
    v_x: float, v_y: float, mean: tuple[float, ...], elapsed_s: float
) -> tuple[float, float]:
    """
    Return a velocity, m/s, after a time at constant specific force and yaw rate, SI.

    The solution of d(v_x)/dt = a_x + r v_y, d(v_y)/dt = a_y - r v_x.
    """
    a_x, a_y, rate = mean
    angle = rate * elapsed_s
    cos, sin = math.cos(angle), math.sin(angle)
    if abs(angle) < _SMALL_ANGLE:
        along, across = elapsed_s, 0.5 * angle * elapsed_s
    else:
        along, across = sin / rate, (1.0 - cos) / rate
    return (
        v_x * cos + v_y * sin + a_x * along + a_y * across,
        v_y * cos - v_x * sin + a_y * along - a_x * across,
    )


def align_samples(readings: Iterable[Reading], aligner: Aligner | None = None) -> list[Sample]:
    """Return the samples of `readings`, which are in order of arrival."""
    aligner = aligner or Aligner()
    samples: list[Sample] = []
    for reading in readings:
        samples.extend(aligner.push(reading))
    return samples
