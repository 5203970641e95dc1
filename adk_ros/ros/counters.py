# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the node counts beside the pipeline's own counts, and all of it at one moment."""

from __future__ import annotations

from collections import Counter, deque
from typing import NamedTuple

import numpy as np

from adk_ros.model.pipeline import Pipeline
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import Source

_TIMES_KEPT = 2400
"""Tick times kept for the percentiles: a minute's."""


class Counters:
    """
    Counts of the node; they only grow, diagnostics take the differences.

    `flagged` counts ticks by their sample's flags, `heard_s` is the monotonic time at which each
    source was heard last, `tick_us` the newest tick times, from message in to messages out.
    """

    def __init__(self) -> None:
        self.internal_errors = 0
        self.last_error = ""
        self.missed_deadlines = 0
        self.withheld = 0
        self.published = 0
        self.resets = 0
        self.flagged: Counter[int] = Counter()
        self.heard_s: list[float | None] = [None for _ in Source]
        self.tick_us: deque[float] = deque(maxlen=_TIMES_KEPT)
        self.tick_max_us = 0.0
        self.innovations = 0
        self.innovation_squares: FloatArray = np.zeros(3)

    def note_innovation(self, innovation: FloatArray) -> None:
        """Add an innovation (3,), if there is one."""
        if np.isfinite(innovation).all():
            self.innovations += 1
            self.innovation_squares += innovation * innovation

    def note_tick(self, spent_us: float) -> None:
        """Add the time that a tick took."""
        self.tick_us.append(spent_us)
        self.tick_max_us = max(self.tick_max_us, spent_us)


class CounterSnapshot(NamedTuple):
    """All counts at one moment, to subtract from those at a later one."""

    now_s: float
    ticks: int
    published: int
    received: Counter[Source]
    refused: Counter[tuple[Source, str]]
    aligned: Counter[str]
    flagged: Counter[int]
    failures: int
    missed: int
    errors: int
    withheld: int
    resets: int
    innovations: int
    innovation_squares: FloatArray


def snapshot(pipeline: Pipeline, counters: Counters, now_s: float) -> CounterSnapshot:
    """Return the counts as they stand."""
    return CounterSnapshot(
        now_s=now_s,
        ticks=pipeline.ticks,
        published=counters.published,
        received=Counter(pipeline.received),
        refused=Counter(pipeline.decoder.refused),
        aligned=Counter(pipeline.aligner.counts),
        flagged=Counter(counters.flagged),
        failures=pipeline.predictor.online.failures,
        missed=counters.missed_deadlines,
        errors=counters.internal_errors,
        withheld=counters.withheld,
        resets=counters.resets,
        innovations=counters.innovations,
        innovation_squares=counters.innovation_squares.copy(),
    )
