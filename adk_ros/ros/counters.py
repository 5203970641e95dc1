# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Counters of the node, and snapshots of them together with those of the pipeline."""

from __future__ import annotations

import math
from collections import Counter, deque
from typing import NamedTuple

import numpy as np

from adk_ros.model.pipeline import Pipeline
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import Source

_MAX_TICK_TIMES = 2400
"""Processing times kept for the percentiles: one minute at 40 Hz."""


class Counters:
    """
    Counters of the node. They only grow; diagnostics report differences.

    `last_received_s` is the monotonic time of the last
    message of each source (s, None: none yet), `last_published_s` that of the last prediction,
    `tick_us` the latest processing times of a sample in µs, from message in to messages out.
    """

    def __init__(self) -> None:
        self.internal_errors = 0
        self.last_error = ""
        self.missed_deadlines = 0
        self.withheld = 0
        self.published = 0
        self.last_published_s: float | None = None
        self.resets = 0
        self.last_received_s: list[float | None] = [None for _ in Source]
        self.tick_us: deque[float] = deque(maxlen=_MAX_TICK_TIMES)
        self.tick_max_us = 0.0
        self.innovations = 0
        self.innovation_squares = [0.0, 0.0, 0.0]

    def note_innovation(self, innovation: FloatArray) -> None:
        """Add an innovation (3,); NaN, for a sample without prediction, is ignored."""
        # Three numbers: plain arithmetic is faster than numpy's.
        v_x, v_y, yaw_rate = innovation.tolist()
        if math.isfinite(v_x + v_y + yaw_rate):
            self.innovations += 1
            squares = self.innovation_squares
            squares[0] += v_x * v_x
            squares[1] += v_y * v_y
            squares[2] += yaw_rate * yaw_rate

    def note_tick(self, elapsed_us: float) -> None:
        """Add the processing time of a sample, µs."""
        self.tick_us.append(elapsed_us)
        self.tick_max_us = max(self.tick_max_us, elapsed_us)


class CounterSnapshot(NamedTuple):
    """All counts at one time, to be subtracted from a later snapshot."""

    now_s: float
    ticks: int
    published: int
    received: Counter[Source]
    refused: Counter[tuple[Source, str]]
    rejected: Counter[Source]
    level_changes: Counter[Source]
    noise_changes: Counter[Source]
    aligned: Counter[str]
    aligned_by_source: Counter[tuple[str, Source]]
    flagged: Counter[int]
    failures: int
    missed: int
    errors: int
    withheld: int
    implausible: int
    resets: int
    innovations: int
    innovation_squares: FloatArray


def snapshot(pipeline: Pipeline, counters: Counters, now_s: float) -> CounterSnapshot:
    """Return the present counts."""
    return CounterSnapshot(
        now_s=now_s,
        ticks=pipeline.ticks,
        published=counters.published,
        received=Counter(pipeline.received),
        refused=Counter(pipeline.decoder.refused),
        rejected=Counter(pipeline.gate.rejected),
        level_changes=Counter(pipeline.gate.level_changes),
        noise_changes=Counter(pipeline.gate.noise_changes),
        aligned=Counter(pipeline.aligner.counts),
        aligned_by_source=Counter(pipeline.aligner.counts_by_source),
        flagged=Counter(pipeline.flagged),
        failures=pipeline.predictor.online.failures,
        missed=counters.missed_deadlines,
        errors=counters.internal_errors,
        withheld=counters.withheld,
        implausible=pipeline.predictor.implausible,
        resets=counters.resets,
        innovations=counters.innovations,
        innovation_squares=np.array(counters.innovation_squares),
    )
