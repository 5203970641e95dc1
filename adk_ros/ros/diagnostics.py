# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Turn the counts of pipeline and node into a level, a message and values, without ROS.

Each finding covers the time since the previous report, so the level recovers as soon as the cause
is gone. The message lists the findings, worst level first; the values hold all counts.

| level | condition | message |
| --- | --- | --- |
| OK | the model is loaded, kernels are compiled | `starting for 12 s: ...` |
| OK | predictions are published | `predicting` |
| OK | never an IMU, and the model needs none | `no IMU: yaw rate from odometry (...)` |
| OK | too few samples so far | `warming up` |
| OK | out-of-order readings, sorted in by stamp | `n readings out of order` |
| OK | a message rate changed by half or more | `imu rate changed from 200 Hz to 100 Hz` |
| OK | the reset service was called | `reset on request` |
| OK | disabled by the service ~/enable | `disabled` |
| OK | the car is driven unlike in training | `extrapolating: v_x 44.1 m/s (trained on ...)` |
| WARN | topics missing, for less than a second | `waiting for odometry, command` |
| WARN | no IMU, but the model was trained with one | `no IMU: ...; the model ...` |
| WARN | no message of the IMU can be used | `IMU is unused: yaw rate from odometry (...)` |
| WARN | a topic stopped, predictions continue | `command timeout (3.2 s): ...` |
| WARN | the report of the steering angle stopped | `steering timeout (1.2 s): commanded ...` |
| WARN | odometry is late at every sample | `odometry arrives more than max_wait_s ...` |
| WARN | no odometry, predictions continue | `coasting for n samples: ...` |
| WARN | a sensor repeats its values in motion | `IMU frozen: ...`, `odometry frozen: ...` |
| WARN | readings contradict the prediction | `2 odometry readings rejected: v_x 37.8 m/s, ...` |
| WARN | consistent readings at another level | `odometry is at a new level: v_x 9.1 m/s, ...` |
| WARN | inconsistent readings in succession | `odometry is noisier than before` |
| WARN | several nodes publish on one input | `2 publishers on the topic of odometry, ...` |
| WARN | messages are refused | `5 command messages refused: joint 'drive' is missing` |
| WARN | implausible stamps, not confirmed later | `3 implausible time stamps ignored (imu 3)` |
| WARN | time jumped, e.g. a looping bag | `clock jumped: all state was reset` |
| WARN | readings are repeated, or too late | `n duplicates (...)`, `n readings too late ...` |
| WARN | wrong unit or sign of the IMU | `... looks like deg/s, the topic must carry rad/s` |
| WARN | velocities in fixed axes | `odometry's velocity turns with the heading: ...` |
| WARN | a channel is not measured | `odometry's v_y is 0 throughout: ...` |
| WARN | a command never changes | `the command's torque is 0 throughout while v_x varies by ...` |
| WARN | wrong frames | `odometry's child_frame_id is 'odom': ...`, `predictions are of the ...` |
| WARN | unusable covariances | `odometry's variance of v_y is negative or not finite: ignored` |
| WARN | plans are refused | `2 planned_command messages refused: the times of the plan ...` |
| WARN | rollouts are refused | `1 roll_out requests refused: too many steps` |
| WARN | a plan is not followed | `delta held: the commands in force contradict the plan` |
| WARN | a sample was processed 25 ms late or more | `n deadlines missed` |
| WARN | the online estimator was reset | `online estimator reset n times` |
| WARN | stamps do not match the others' | `command stamps are 0.1 s ahead of the other ...` |
| WARN | ... so that the stream is not used | `imu is unused: imu stamps are 10 years ...` |
| WARN | `use_sim_time` without a clock | `simulation time has not started: no /clock` |
| ERROR | nothing predicted for a second: | |
| ERROR | - a required topic stopped | `no predictions: odometry timeout (2.0 s)` |
| ERROR | - a topic is missing | `no predictions: odometry never received on /odometry` |
| ERROR | - no message can be used | `no predictions: all command messages are refused` |
| ERROR | - wrong stamps | `no predictions: odometry stamps are stuck: ...` |
| ERROR | - no simulation time | `no predictions: ... simulation time has not started` |
| ERROR | - other | `no predictions: odometry is frozen`, `... no prediction is finite` |
| ERROR | `use_imu` is `required`, no IMU | `no IMU, but use_imu is 'required' (...)` |
| ERROR | an exception was caught, state reset | `n internal errors, last: ...` |
| ERROR | no vehicle can move as predicted | `n predictions withheld: no vehicle ...` |
| ERROR | a prediction was not finite | `n predictions withheld: not finite` |
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import NamedTuple

from adk_ros.model.prediction import Status
from adk_ros.model.training_range import TrainingRange
from adk_ros.ros.core import Core
from adk_ros.ros.counters import snapshot
from adk_ros.ros.diagnostic_values import Clocks, diagnostic_values
from adk_ros.ros.outage import REQUIRED, Situation, outage_reasons, stream_reason
from adk_ros.ros.plan_report import PlanReport
from adk_ros.ros.stamp_report import stamp_report
from adk_ros.signals.channels import Flag, Source

OUTAGE_S = 1.0
"""s without a prediction after which the level is ERROR: 40 samples, of which 5 to 9 pass without
one after a start or a jump of the clock. The default of `max_coast_s`."""

_WITHOUT = {
    Source.COMMAND: ": last command is used",
    Source.STEERING: ": commanded steering angle is used",
}
"""What is used instead of a stream that has timed out, while predictions go on."""
_RATE_CHANGE = 1.5
"""Ratio of rates that counts as a change: below a halving, above the jitter of usual drivers."""

_RATE_TRACKING = 0.3
"""Share of a rate's deviation that each report takes over, so that slow drift is not reported."""

_MANY_REJECTED, _MIN_SHARE_READINGS = 0.2, 10
"""Share of rejected readings, of at least so many, from which a second publisher is suggested: two
at equal rates have half of them rejected."""


class Level(IntEnum):
    """Level of a diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


class DiagnosticReport(NamedTuple):
    """Level, message and (key, value) pairs of one DiagnosticStatus."""

    level: Level
    message: str
    values: list[tuple[str, str]]


class Diagnostics:
    """
    Diagnose the core of a node; call `report` about once a second, and when `is_overdue`.

    :param facts: constant pairs that each report starts with: model, hash, method, topics.
    :param use_imu: the parameter of that name: auto, required or never.
    :param start_s: monotonic time, s, at which counting starts.
    :param trained: range of the data that the model was trained on, if it is known.
    """

    def __init__(
        self,
        core: Core,
        facts: Mapping[str, str] | None = None,
        use_imu: str = "auto",
        start_s: float = 0.0,
        trained: TrainingRange | None = None,
    ) -> None:
        self._core = core
        self._pipeline = core.pipeline
        self._counters = core.counters
        self._facts = dict(facts or {})
        self._use_imu = use_imu
        self._start_s = start_s
        self._trained = trained
        self._plans = PlanReport(core)
        self._in_outage = False
        self._rates: dict[Source, float] = {}
        self._findings: list[tuple[Level, str]] = []
        self._before = snapshot(self._pipeline, self._counters, start_s)
        self._now = self._before
        self._past = deque([self._before])

    def report(
        self, clocks: Clocks, publishers: Mapping[Source, Sequence[str]] | None = None
    ) -> DiagnosticReport:
        """
        Return the report on the time since the previous call.

        :param publishers: full names of the nodes that publish on the topic of each source.
        """
        self._before, self._now = self._now, snapshot(self._pipeline, self._counters, clocks.now_s)
        self._past.append(self._now)
        while clocks.now_s - self._past[1].now_s >= OUTAGE_S:
            self._past.popleft()
        wait_s = self._pipeline.settings.max_wait_s
        self._stamps = stamp_report(self._core.stamps, clocks, wait_s)
        self._seen = Situation(
            self._pipeline,
            self._counters,
            self._past[0],
            self._now,
            self._stamps,
            clocks,
            self._facts,
        )
        self._findings = []
        if self._core.enabled:
            self._check_streams()
        else:
            self._add(Level.OK, "disabled")
        self._check_publishers(publishers or {})
        self._check_node()
        if clocks.sim_time and clocks.ros_ns == 0 and not self._in_outage:
            self._add(Level.WARN, "simulation time has not started: no /clock")
        level = max((found[0] for found in self._findings), default=Level.OK)
        # Worst level first; the sort is stable, so findings of one level keep their order.
        texts = [text for _, text in sorted(self._findings, key=lambda found: -found[0])]
        predicts = self._core.enabled and self._now.published > self._before.published
        if level is Level.OK and predicts:
            texts.insert(0, "predicting")
        further = {
            "prediction_age_s": self._outage_s(clocks.now_s),
            **self._stamps.values(),
            **self._plans.values(),
            "extrapolating": ", ".join(self._beyond_training()) or "no",
        }
        values = diagnostic_values(
            self._pipeline, self._counters, self._before, self._now, clocks, further
        )
        values = [*self._facts.items(), *values]
        return DiagnosticReport(level, "; ".join(texts) or "predicting", values)

    def begin(self, now_s: float) -> None:
        """Count the time without predictions from now on, when the node has been enabled."""
        self._start_s = now_s
        self._in_outage = False

    def is_overdue(self, now_s: float) -> bool:
        """Return whether an outage has begun that no report tells of yet."""
        if not self._core.enabled:
            return False
        return not self._in_outage and self._outage_s(now_s) >= OUTAGE_S

    def _outage_s(self, now_s: float) -> float:
        """Return the seconds since the last prediction, or since the start."""
        return now_s - max(self._start_s, self._counters.last_published_s or self._start_s)

    def _check_streams(self) -> None:
        self._check_predictions()
        self._check_imu()
        self._check_stamps()
        self._check_messages()
        self._check_samples()

    def _add(self, level: Level, text: str) -> None:
        self._findings.append((level, text))

    def _check_predictions(self) -> None:
        now, before = self._now, self._before
        self._in_outage = self._outage_s(now.now_s) >= OUTAGE_S
        missing = [source for source in REQUIRED if not self._has_readings(source)]
        if self._in_outage:
            self._add(Level.ERROR, "no predictions: " + ", ".join(outage_reasons(self._seen)))
        elif now.published > before.published:
            for source in (*REQUIRED, Source.STEERING):
                if age_s := self._seen.timeout_s(source):
                    text = f"{source.name.lower()} timeout ({age_s:.1f} s)"
                    self._add(Level.WARN, text + _WITHOUT.get(source, ""))
        elif missing:
            names = [source.name.lower() for source in missing]
            self._add(Level.WARN, "waiting for " + ", ".join(names))
        elif self._pipeline.predictor.status is Status.NO_STATE:
            self._add(Level.WARN, "no usable state or command")
        elif self._pipeline.predictor.status is not Status.IMPLAUSIBLE:
            self._add(Level.OK, "warming up")

    def _has_readings(self, source: Source) -> bool:
        return bool(self._pipeline.aligner.streams[source])

    def _check_imu(self) -> None:
        if self._use_imu == "never" or not self._pipeline.ticks:
            return
        timeout_s = self._seen.timeout_s(Source.IMU)
        reason = stream_reason(self._seen, Source.IMU)
        # Stamps that only deviate do not keep the IMU from being used.
        unused = reason != self._stamps.fault(Source.IMU) or not self._stamps.is_used(Source.IMU)
        if self._use_imu == "required" and reason and unused:
            self._add(Level.ERROR, f"no IMU, but use_imu is 'required' ({reason})")
        elif timeout_s:
            predicting = self._now.published > self._before.published
            consequence = ": yaw rate from odometry" if predicting else ""
            self._add(Level.WARN, f"IMU timeout ({timeout_s:.1f} s){consequence}")
        elif not self._has_readings(Source.IMU):
            reason = reason or "its stamps are of another time"
            lack = "IMU is unused" if self._now.received[Source.IMU] else "no IMU"
            text = f"{lack}: yaw rate from odometry ({reason})"
            if self._use_imu == "required":
                self._add(Level.ERROR, f"no IMU, but use_imu is 'required' ({reason})")
            elif self._pipeline.predictor.model.uses_imu:
                self._add(Level.WARN, text + "; the model was trained with one")
            else:
                self._add(Level.OK, text)

    def _check_publishers(self, publishers: Mapping[Source, Sequence[str]]) -> None:
        for source, nodes in publishers.items():
            if len(nodes) > 1:
                names = ", ".join(sorted(nodes))
                self._add(
                    Level.WARN,
                    f"{len(nodes)} publishers on the topic of {source.name.lower()}, stop all but "
                    f"one: {names}",
                )

    def _check_stamps(self) -> None:
        """Name the streams whose stamps do not fit; right after a jump they cannot be compared."""
        if self._now.aligned["clock jump"] > self._before.aligned["clock jump"]:
            return
        for source in Source:
            fault = self._stamps.fault(source)
            if fault is None or any(fault in text for _, text in self._findings):
                continue
            if not self._stamps.is_used(source):
                fault = f"{source.name.lower()} is unused: {fault}"
            self._add(Level.WARN, fault)

    def _check_messages(self) -> None:
        now, before = self._now, self._before
        for (source, reason), count in sorted((now.refused - before.refused).items()):
            self._add(Level.WARN, f"{count} {source.name.lower()} messages refused: {reason}")
        self._check_gate()
        aligned = now.aligned - before.aligned
        rows = (
            ("clock jump", Level.WARN, "clock jumped: all state was reset"),
            ("stray stamp", Level.WARN, "{} implausible time stamps ignored"),
            ("duplicate", Level.WARN, "{} duplicates"),
            ("late", Level.WARN, "{} readings too late for their sample"),
            ("out of order", Level.OK, "{} readings out of order"),
        )
        for key, level, text in rows:
            if aligned[key]:
                self._add(level, text.format(aligned[key]) + self._by_source(key))
        for source in Source:
            self._check_rate(source)

    def _by_source(self, key: str) -> str:
        """Return the counts of an event of the alignment by stream, if they are known."""
        new = self._now.aligned_by_source - self._before.aligned_by_source
        parts = [
            f"{source.name.lower()} {new[key, source]}" for source in Source if new[key, source]
        ]
        return f" ({', '.join(parts)})" if parts else ""

    def _check_gate(self) -> None:
        now, before = self._now, self._before
        for source, latest in sorted(self._pipeline.gate.latest.items()):
            name = source.name.lower()
            rejected = now.rejected[source] - before.rejected[source]
            received = now.received[source] - before.received[source]
            if rejected:
                hint = ""
                if received > _MIN_SHARE_READINGS and rejected > _MANY_REJECTED * received:
                    hint = "; if another node publishes on this topic, stop one of the two"
                noun = "reading" if rejected == 1 else "readings"
                self._add(Level.WARN, f"{rejected} {name} {noun} rejected: {latest}{hint}")
            if now.level_changes[source] > before.level_changes[source]:
                self._add(Level.WARN, f"{name} is at a new level: {latest}")
            if now.noise_changes[source] > before.noise_changes[source]:
                self._add(Level.WARN, f"{name} is noisier than before: {latest}")

    def _check_rate(self, source: Source) -> None:
        period_ns = self._pipeline.aligner.streams[source].period_ns
        if period_ns <= 0.0:
            return
        rate = 1e9 / period_ns
        old = self._rates.get(source, rate)
        if not 1.0 / _RATE_CHANGE < rate / old < _RATE_CHANGE:
            name = source.name.lower()
            self._add(Level.OK, f"{name} rate changed from {old:.0f} Hz to {rate:.0f} Hz")
            old = rate
        self._rates[source] = old + _RATE_TRACKING * (rate - old)

    def _count_flagged(self, *flags: Flag) -> int:
        """Return the number of samples since the previous report that have all of `flags`."""
        return self._seen._replace(before=self._before).flagged(*flags)

    def _check_samples(self) -> None:
        frozen = self._count_flagged(Flag.FROZEN)
        odometry_frozen = self._count_flagged(Flag.FROZEN, Flag.COASTING)
        if odometry_frozen:
            self._add(Level.WARN, "odometry frozen: it repeats the same values")
        if frozen > odometry_frozen:
            self._add(Level.WARN, "IMU frozen: it repeats the same values")
        coasting = self._count_flagged(Flag.COASTING)
        if coasting and self._now.published > self._before.published:
            self._add(Level.WARN, f"coasting for {coasting} samples: no recent odometry")
        self._check_lateness()
        for text in self._pipeline.plausibility.warnings() + self._core.message_warnings():
            self._add(Level.WARN, text)
        if beyond := self._beyond_training():
            self._add(Level.OK, "extrapolating: " + ", ".join(beyond))
        for text in self._plans.warnings():
            self._add(Level.WARN, text)

    def _check_lateness(self) -> None:
        """Say if odometry arrives too late for every sample, which no timeout shows."""
        ticks = self._now.ticks - self._before.ticks
        stale = self._count_flagged(Flag.ODOMETRY_STALE)
        if not ticks or stale < ticks or self._count_flagged(Flag.COASTING):
            return
        if self._seen.timeout_s(Source.ODOMETRY) or not self._seen.received(Source.ODOMETRY):
            return
        wait_s = self._pipeline.settings.max_wait_s
        self._add(
            Level.WARN,
            f"odometry arrives more than max_wait_s ({wait_s:g} s) after the other streams: every "
            "sample has an old velocity, and nothing is learnt",
        )

    def _beyond_training(self) -> list[str]:
        """Return what of the present sample lies outside the training data, while predicting."""
        sample = self._pipeline.last_sample
        predicts = self._now.published > self._before.published
        if self._trained is None or sample is None or not predicts:
            return []
        return self._trained.beyond(sample)

    def _check_node(self) -> None:
        now, before = self._now, self._before
        if now.errors > before.errors:
            last = self._counters.last_error
            self._add(Level.ERROR, f"{now.errors - before.errors} internal errors, last: {last}")
        if now.withheld > before.withheld:
            count = now.withheld - before.withheld
            self._add(Level.ERROR, f"{count} predictions withheld: not finite")
        if now.implausible > before.implausible:
            count = now.implausible - before.implausible
            self._add(Level.ERROR, f"{count} predictions withheld: no vehicle moves as predicted")
        if now.missed > before.missed:
            self._add(Level.WARN, f"{now.missed - before.missed} deadlines missed")
        if now.failures > before.failures:
            count = now.failures - before.failures
            self._add(Level.WARN, f"online estimator reset {count} times")
        if now.resets > before.resets:
            self._add(Level.OK, "reset on request")
