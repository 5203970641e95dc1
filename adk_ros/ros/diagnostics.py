# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the pipeline and the node counted -> a level, a sentence and values. No ROS in here.

Every finding is about the time since the last report, so the level recovers with its cause. The
message holds the findings of the worst level first; the values hold everything, always.

| level | when | message |
| --- | --- | --- |
| OK | predictions are made | `predicting` |
| OK | there never was an IMU and the model needs none | `no IMU: yaw rate from odometry` |
| OK | too few samples yet | `warming up` |
| OK | readings came out of order and were used in their place | `n readings out of order` |
| OK | a stream's rate changed by half or more | `imu now comes at 100 Hz, before at 200 Hz` |
| OK | the reset service was called | `reset on request` |
| WARN | nothing received yet, or not all of it for 5 s at most | `waiting for odometry, command` |
| WARN | no IMU, though the model was trained with one | `no IMU: ...; the model ...` |
| WARN | a stream fell silent while predictions go on | `command silent for 3.2 s: ...` |
| WARN | no state was measured: predictions go on from themselves | `coasting for n ticks` |
| WARN | a moving vehicle's sensor repeats itself | `IMU frozen`, `odometry frozen` |
| WARN | messages cannot be used | `5 command refused: joint 'drive' is missing` |
| WARN | stamps far off the others, not confirmed | `3 stray stamps ignored` |
| WARN | the clock jumped, a bag looped | `clock jumped: all state was reset` |
| WARN | readings came twice, or after their tick | `n duplicates`, `n readings too late` |
| WARN | IMU in g or deg/s, axes flipped | what looks wrong and what the topic must carry |
| WARN | a tick was done 25 ms late or more | `n deadlines missed` |
| WARN | the online method had to start afresh | `online method set back n times` |
| WARN | `use_sim_time` without a clock | `sim time has not started: no /clock` |
| ERROR | streams fell silent, nothing is predicted | `no predictions: odometry silent for 2.0 s` |
| ERROR | a needed stream is missing for over 5 s | `no predictions: odometry never received` |
| ERROR | `use_imu` is required and there is none | `no IMU, but use_imu is 'required'` |
| ERROR | a fault in this program was caught, state reset | `n internal errors, the last: ...` |
| ERROR | a prediction was not finite and was withheld | `n predictions withheld` |
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

from adk_ros.model.pipeline import Pipeline
from adk_ros.model.prediction import Status
from adk_ros.ros.counters import Counters, snapshot
from adk_ros.ros.diagnostic_values import Clocks, describe
from adk_ros.signals.channels import Flag, Source

_STARTUP_GRACE_S = 5.0
_SILENT_AFTER_S = 1.0
_SILENT_PERIODS = 5.0
_CHANGED_RATE = 1.5
_NEEDED = (Source.ODOMETRY, Source.COMMAND)


class Level(IntEnum):
    """As in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


class DiagnosticReport(NamedTuple):
    """Level, sentence and (key, value) pairs of one DiagnosticStatus."""

    level: Level
    message: str
    values: list[tuple[str, str]]


class Diagnostics:
    """
    Watches one pipeline; `report` is called about once a second.

    :param facts: pairs to show as they are: model, hash, method, topics.
    :param use_imu: as the parameter: auto, required or never.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        counters: Counters,
        facts: Mapping[str, str] | None = None,
        use_imu: str = "auto",
        start_s: float = 0.0,
    ) -> None:
        self._pipeline = pipeline
        self._counters = counters
        self._facts = list((facts or {}).items())
        self._use_imu = use_imu
        self._first_s: float | None = None
        self._rates: dict[Source, float] = {}
        self._findings: list[tuple[Level, str]] = []
        self._before = snapshot(pipeline, counters, start_s)
        self._now = self._before

    def report(self, clocks: Clocks) -> DiagnosticReport:
        """Return what happened since the last call."""
        self._before, self._now = self._now, snapshot(self._pipeline, self._counters, clocks.now_s)
        self._findings = []
        self._look_at_predictions()
        self._look_at_imu()
        self._look_at_messages()
        self._look_at_samples()
        self._look_at_node()
        if clocks.sim_time and clocks.ros_ns == 0:
            self._find(Level.WARN, "sim time has not started: no /clock")
        level = max((found[0] for found in self._findings), default=Level.OK)
        # The worst comes first; sorting is stable, so the rest keeps its order.
        texts = [text for _, text in sorted(self._findings, key=lambda found: -found[0])]
        if level is Level.OK and self._now.published > self._before.published:
            texts.insert(0, "predicting")
        values = describe(self._pipeline, self._counters, self._before, self._now, clocks)
        return DiagnosticReport(level, "; ".join(texts) or "predicting", [*self._facts, *values])

    def _find(self, level: Level, text: str) -> None:
        self._findings.append((level, text))

    def _silence_s(self, source: Source) -> float:
        """Seconds for which a source that was heard has been silent, 0 while it is alive."""
        heard_s = self._counters.heard_s[source]
        if heard_s is None:
            return 0.0
        period_s = self._pipeline.aligner.streams[source].period_ns * 1e-9
        silence_s = self._now.now_s - heard_s
        return silence_s if silence_s > max(_SILENT_AFTER_S, _SILENT_PERIODS * period_s) else 0.0

    def _silences(self) -> list[str]:
        return [
            f"{source.name.lower()} silent for {silence_s:.1f} s"
            for source in (Source.ODOMETRY, Source.COMMAND)
            if (silence_s := self._silence_s(source))
        ]

    def _look_at_predictions(self) -> None:
        now, before = self._now, self._before
        if self._first_s is None and any(now.received.values()):
            self._first_s = now.now_s
        silences = self._silences()
        if now.published > before.published:
            for text in silences:
                held = ": the last one is held" if text.startswith("command") else ""
                self._find(Level.WARN, text + held)
            return
        lacking = [self._missing_reason(source) for source in _NEEDED if not self._known(source)]
        if silences:
            self._find(Level.ERROR, "no predictions: " + ", ".join(silences))
        elif lacking:
            late = self._first_s is not None and now.now_s - self._first_s > _STARTUP_GRACE_S
            if late:
                self._find(Level.ERROR, "no predictions: " + ", ".join(lacking))
            else:
                names = [s.name.lower() for s in _NEEDED if not self._known(s)]
                self._find(Level.WARN, "waiting for " + ", ".join(names))
        elif self._pipeline.predictor.status is Status.NO_STATE:
            self._find(Level.ERROR, "no predictions: no usable state or command")
        else:
            self._find(Level.OK, "warming up")

    def _known(self, source: Source) -> bool:
        return bool(self._pipeline.aligner.streams[source])

    def _missing_reason(self, source: Source) -> str:
        name = source.name.lower()
        if not self._now.received[source]:
            return f"{name} never received"
        refused = sum(
            (self._now.refused - self._before.refused)[key]
            for key in self._now.refused
            if key[0] is source
        )
        if refused:
            return f"all {name} messages are refused"
        return f"{name} has stamps of another time than the other streams"

    def _look_at_imu(self) -> None:
        if self._use_imu == "never" or not self._pipeline.ticks:
            return
        silence_s = self._silence_s(Source.IMU)
        if silence_s:
            predicting = self._now.published > self._before.published
            instead = ": yaw rate from odometry" if predicting else ""
            self._find(Level.WARN, f"IMU silent for {silence_s:.1f} s{instead}")
        elif not self._known(Source.IMU):
            lack = self._missing_reason(Source.IMU)
            text = f"no IMU: yaw rate from odometry ({lack})"
            if self._use_imu == "required":
                self._find(Level.ERROR, f"no IMU, but use_imu is 'required' ({lack})")
            elif self._pipeline.predictor.model.uses_imu:
                self._find(Level.WARN, text + "; the model was trained with one")
            else:
                self._find(Level.OK, text)

    def _look_at_messages(self) -> None:
        now, before = self._now, self._before
        for (source, reason), count in sorted((now.refused - before.refused).items()):
            self._find(Level.WARN, f"{count} {source.name.lower()} refused: {reason}")
        aligned = now.aligned - before.aligned
        rows = (
            ("clock jump", Level.WARN, "clock jumped: all state was reset"),
            ("stray stamp", Level.WARN, "{} stray stamps ignored"),
            ("duplicate", Level.WARN, "{} duplicates"),
            ("late", Level.WARN, "{} readings too late for their tick"),
            ("out of order", Level.OK, "{} readings out of order"),
        )
        for key, level, text in rows:
            if aligned[key]:
                self._find(level, text.format(aligned[key]))
        for source in Source:
            self._watch_rate(source)

    def _watch_rate(self, source: Source) -> None:
        period_ns = self._pipeline.aligner.streams[source].period_ns
        if period_ns <= 0.0:
            return
        rate = 1e9 / period_ns
        old = self._rates.get(source, rate)
        if not 1.0 / _CHANGED_RATE < rate / old < _CHANGED_RATE:
            self._find(
                Level.OK,
                f"{source.name.lower()} now comes at {rate:.0f} Hz, before at {old:.0f} Hz",
            )
            old = rate
        # Slow drift is followed, so that only a change within some seconds is told.
        self._rates[source] = old + 0.3 * (rate - old)

    def _flag_ticks(self, *flags: Flag) -> int:
        fresh = self._now.flagged - self._before.flagged
        wanted = sum(flags)
        return sum(count for bits, count in fresh.items() if bits & wanted == wanted)

    def _look_at_samples(self) -> None:
        frozen = self._flag_ticks(Flag.FROZEN)
        odometry_frozen = self._flag_ticks(Flag.FROZEN, Flag.COASTING)
        if odometry_frozen:
            self._find(Level.WARN, "odometry frozen: it repeats itself to the last bit")
        if frozen > odometry_frozen:
            self._find(Level.WARN, "IMU frozen: it repeats itself to the last bit")
        coasting = self._flag_ticks(Flag.COASTING)
        if coasting and self._now.published > self._before.published:
            self._find(Level.WARN, f"coasting for {coasting} ticks: no fresh odometry")
        for text in self._pipeline.plausibility.warnings():
            self._find(Level.WARN, text)

    def _look_at_node(self) -> None:
        now, before = self._now, self._before
        if now.errors > before.errors:
            last = self._counters.last_error
            self._find(Level.ERROR, f"{now.errors - before.errors} internal errors, last: {last}")
        if now.withheld > before.withheld:
            count = now.withheld - before.withheld
            self._find(Level.ERROR, f"{count} predictions withheld: not finite")
        if now.missed > before.missed:
            self._find(Level.WARN, f"{now.missed - before.missed} deadlines missed")
        if now.failures > before.failures:
            count = now.failures - before.failures
            self._find(Level.WARN, f"online method set back {count} times")
        if now.resets > before.resets:
            self._find(Level.OK, "reset on request")
