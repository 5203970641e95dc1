# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Why nothing is predicted: the reasons, by stream and in general.

The gate is none of them: without a state to compare with it accepts everything.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from adk_ros.model.pipeline import Pipeline
from adk_ros.model.prediction import Status
from adk_ros.ros.counters import Counters, CounterSnapshot
from adk_ros.ros.diagnostic_values import Clocks
from adk_ros.ros.stamp_report import StampReport
from adk_ros.signals.channels import Flag, Source

REQUIRED = (Source.ODOMETRY, Source.COMMAND)
"""Streams without which nothing is predicted."""

_TIMEOUT_S = 1.0
"""s without a message after which a topic is reported: the default period of the reports."""

_TIMEOUT_PERIODS = 5.0
"""Message periods without a message after which a topic slower than 5 Hz is reported."""


class Situation(NamedTuple):
    """What the reasons are read from: counts since `before`, at least a second ago, and stamps."""

    pipeline: Pipeline
    counters: Counters
    before: CounterSnapshot
    now: CounterSnapshot
    stamps: StampReport
    clocks: Clocks
    topics: Mapping[str, str]
    """Name of the topic by name of the source, for the messages."""

    def timeout_s(self, source: Source) -> float:
        """Return the seconds since the last message of a timed-out source, else 0."""
        received_s = self.counters.last_received_s[source]
        if received_s is None:
            return 0.0
        period_s = self.pipeline.aligner.streams[source].period_ns * 1e-9
        age_s = self.now.now_s - received_s
        return age_s if age_s > max(_TIMEOUT_S, _TIMEOUT_PERIODS * period_s) else 0.0

    def received(self, source: Source) -> int:
        """Return the number of messages of a source."""
        return self.now.received[source] - self.before.received[source]

    def refused(self, source: Source) -> int:
        """Return the number of messages of a source that the decoder refused."""
        new = self.now.refused - self.before.refused
        return sum(count for (refused, _), count in new.items() if refused is source)

    def flagged(self, *flags: Flag) -> int:
        """Return the number of samples that have all of `flags`."""
        new = self.now.flagged - self.before.flagged
        mask = sum(flags)
        return sum(count for bits, count in new.items() if bits & mask == mask)


def stream_reason(seen: Situation, source: Source) -> str | None:
    """Return why readings of a stream are not used, None if they are."""
    name = source.name.lower()
    if not seen.now.received[source]:
        topic = seen.topics.get(name)
        return f"{name} never received" + (f" on {topic}" if topic else "")
    timeout_s = seen.timeout_s(source)
    if timeout_s:
        return f"{name} timeout ({timeout_s:.1f} s)"
    refused = seen.refused(source)
    if refused and refused >= seen.received(source):
        return f"all {name} messages are refused"
    return seen.stamps.fault(source)


def outage_reasons(seen: Situation) -> list[str]:
    """Return the reasons why nothing is predicted, at least one."""
    reasons = [text for source in REQUIRED if (text := stream_reason(seen, source))]
    if seen.clocks.sim_time and seen.clocks.ros_ns == 0:
        reasons.append("simulation time has not started: no /clock")
    if not reasons:
        reasons.append(_general_reason(seen))
    return reasons


def _general_reason(seen: Situation) -> str:
    before, now = seen.before, seen.now
    status = seen.pipeline.predictor.status
    if now.errors > before.errors:
        return "internal errors"
    if status is Status.IMPLAUSIBLE or now.implausible > before.implausible:
        return "all predictions are implausible"
    if now.withheld > before.withheld:
        return "no prediction is finite"
    jumps = now.aligned["clock jump"] - before.aligned["clock jump"]
    if jumps:
        return f"the clock jumped {jumps} times"
    if seen.flagged(Flag.FROZEN, Flag.COASTING):
        return "odometry is frozen"
    if now.ticks == before.ticks:
        return "no sample was completed"
    if status is Status.NO_STATE:
        return "no usable state or command"
    return "too few usable samples in succession"
