# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The key/value pairs of a diagnostics report: all counts, rates and times, as text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from adk_ros.model.pipeline import Pipeline
from adk_ros.ros.counters import Counters, CounterSnapshot
from adk_ros.signals.channels import STATE_NAMES, Flag, Source
from adk_ros.signals.gate import CHANNELS

_ALIGNER_KEYS = {
    "stray stamp": "stray_stamps",
    "clock jump": "clock_jumps",
    "duplicate": "duplicates",
    "out of order": "out_of_order",
    "late": "late",
}


class Clocks(NamedTuple):
    """Times of a report: `now_s` monotonic; `ros_ns` ROS clock, 0 until simulation time starts."""

    now_s: float
    ros_ns: int = 0
    sim_time: bool = False


def diagnostic_values(
    pipeline: Pipeline,
    counters: Counters,
    before: CounterSnapshot,
    now: CounterSnapshot,
    clocks: Clocks,
    further: Mapping[str, object],
) -> list[tuple[str, str]]:
    """Return the pairs: totals since start-up, rates and RMS values since `before`, `further`."""
    values: dict[str, object] = {
        "status": pipeline.predictor.status.value,
        "ticks": now.ticks,
        "predictions": now.published,
    }
    elapsed_s = max(now.now_s - before.now_s, 1e-9)
    for source in Source:
        if source is Source.STEERING and not now.received[source]:
            continue
        name = source.name.lower()
        received_s = counters.last_received_s[source]
        values[f"{name}.received"] = now.received[source]
        values[f"{name}.rate_hz"] = (now.received[source] - before.received[source]) / elapsed_s
        values[f"{name}.age_s"] = math.nan if received_s is None else clocks.now_s - received_s
        if source in CHANNELS:
            values[f"{name}.rejected"] = now.rejected[source]
            values[f"{name}.level_changes"] = now.level_changes[source]
            values[f"{name}.latest_rejection"] = pipeline.gate.latest.get(source, "none")
    for (source, reason), count in sorted(now.refused.items()):
        values[f"{source.name.lower()}.refused: {reason}"] = count
    for key, name in _ALIGNER_KEYS.items():
        values[name] = now.aligned[key]
    for flag in Flag:
        if flag:
            total = sum(count for bits, count in now.flagged.items() if bits & flag)
            values[f"ticks_{str(flag.name).lower()}"] = total
    newest_ns = pipeline.aligner.newest_ns
    if newest_ns is not None and clocks.ros_ns:
        values["stamps_behind_clock_s"] = (clocks.ros_ns - newest_ns) * 1e-9
    values |= {
        "restarts": pipeline.restarts,
        "resets_on_request": now.resets,
        "missed_deadlines": now.missed,
        "internal_errors": now.errors,
        "predictions_withheld": now.withheld,
        "predictions_implausible": now.implausible,
        "online_failures": now.failures,
        "condition_number": pipeline.predictor.online.condition_number(),
    }
    values |= _tick_times(counters)
    values |= _prediction_quality(pipeline, before, now)
    values |= further
    return [(key, _as_text(value)) for key, value in values.items()]


def _tick_times(counters: Counters) -> dict[str, float]:
    times = np.array(counters.tick_us or [math.nan])
    p50, p99 = np.percentile(times, (50, 99)).tolist()
    return {"tick_p50_us": p50, "tick_p99_us": p99, "tick_max_us": counters.tick_max_us}


def _prediction_quality(
    pipeline: Pipeline, before: CounterSnapshot, now: CounterSnapshot
) -> dict[str, float]:
    count = now.innovations - before.innovations
    squares = (now.innovation_squares - before.innovation_squares).tolist()
    disturbances = pipeline.predictor.disturbance.tolist()
    quality = {}
    for name, square in zip(STATE_NAMES, squares, strict=True):
        quality[f"innovation_rms.{name}"] = math.sqrt(square / count) if count else math.nan
    for name, disturbance in zip(STATE_NAMES, disturbances, strict=True):
        quality[f"disturbance.{name}"] = disturbance
    return quality


def _as_text(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)
