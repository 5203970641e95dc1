# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The watch: readings in, changes out.

`Watch.push` only stores a reading; `Watch.step` does one piece of work of some 0.1 s: it closes a
block and looks for a change, or fits one effect of a change that is being named. So a node can
spread the work and stay responsive, and a replay can call it until nothing is left to do.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator
from dataclasses import replace

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.criteria import MIN_SPEED
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.mismatch.surrogate.substeps import scale_of
from adk_ros.mismatch.watch.block import BlockLineariser
from adk_ros.mismatch.watch.candidate_columns import ColumnLayout
from adk_ros.mismatch.watch.change import FINAL, PRELIMINARY, WITHDRAWN, Change
from adk_ros.mismatch.watch.change_statistics import ChangeStatistics
from adk_ros.mismatch.watch.naming import NamedChange, name_change
from adk_ros.mismatch.watch.sensor_buffer import SensorBuffer
from adk_ros.mismatch.watch.settings import (
    ALARM_THRESHOLD,
    BLOCK_S,
    HOLD_BLOCKS,
    LOOK_AHEAD_S,
    MAX_LATENESS_S,
    NAMING_BLOCKS,
    NOISE_BLOCKS,
    REFERENCE_BLOCKS,
    WARM_UP_S,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import Reading

WAITING, LEARNING, WATCHING, CHANGED = "waiting", "learning", "watching", "changed"
_KEPT_CHANGES = 100

Span = tuple[float, float]


class Watch:
    """
    Watches one car. `on_change` is called with each change, and again with each revision.

    `state`: waiting (for data), learning (the reference), watching, changed (a change is being
    named). `number` of changes so far; `threshold` of the statistic; `blocks_used` and
    `blocks_skipped` count blocks.
    """

    def __init__(
        self,
        surrogate: SurrogateModel,
        on_change: Callable[[Change], None],
        threshold: float = ALARM_THRESHOLD,
    ) -> None:
        # What is known of its error needs the transients of more than a block.
        self._surrogate = replace(surrogate, systematic=None)
        self._on_change, self.threshold = on_change, threshold
        self.base: tuple[ActiveEffect, ...] = ()
        self.restarts = 0
        self.changes: deque[Change] = deque(maxlen=_KEPT_CHANGES)
        self.number = 0
        self._restart()

    def restart(self) -> None:
        """Forget all readings and what was learned of them, as when the clock was set."""
        self.restarts += 1
        self._restart()

    def _restart(self) -> None:
        self.buffer = SensorBuffer(scale_of(self._surrogate.parameters))
        self.base = ()
        self.blocks_used = self.blocks_skipped = 0
        self.statistic = 0.0
        self.likely = ""
        self._due_s: float | None = None
        self._pending: deque[tuple[SensorLog, Span]] = deque()
        self._sigma: FloatArray | None = None
        self._layout: ColumnLayout | None = None
        self._statistics: ChangeStatistics | None = None
        self._lineariser: BlockLineariser | None = None
        self._clear_alarm()

    def _clear_alarm(self) -> None:
        self._held = 0
        self._alarm_s: float | None = None
        self._alarm_blocks = 0
        self._revisions = list(NAMING_BLOCKS)
        self._naming: Generator[None, None, NamedChange] | None = None
        self._naming_until_s = 0.0

    @property
    def state(self) -> str:
        """What the watch is doing."""
        if self._alarm_s is not None:
            return CHANGED
        if self._statistics is None:
            return WAITING if self.blocks_used == 0 else LEARNING
        return WATCHING if self._statistics.is_ready else LEARNING

    @property
    def reference_share(self) -> float:
        """Share of the reference that is learnt."""
        count = 0 if self._statistics is None else self._statistics.count
        return min(count / REFERENCE_BLOCKS, 1.0)

    def push(self, reading: Reading, pose: tuple[float, float, float] | None = None) -> None:
        """
        Store a reading; `pose` (x, y, heading) belongs to one of odometry.

        Its stamp is taken as it is: `StampFilter` keeps wrong ones away.
        """
        self.buffer.push(reading, pose)

    def step(self) -> bool:
        """Do one piece of work; return whether there was any."""
        if self._naming is not None:
            self._continue_naming()
            return True
        stretch = self._next_stretch()
        if stretch is None:
            return False
        log, span = stretch
        if log is None:
            self.blocks_skipped += 1
        else:
            self._take(log, span)
        return True

    def run(self) -> None:
        """Do all the work that the readings allow."""
        while self.step():
            pass

    def _next_stretch(self) -> tuple[SensorLog | None, Span] | None:
        """Return the readings of the next block that is complete; their log is None for a gap."""
        buffer = self.buffer
        until_s, newest_s = buffer.measured_until_s, buffer.newest_s
        if not np.isfinite(until_s):
            return None
        if self._due_s is None:
            self._due_s = max(0.0, until_s) + WARM_UP_S
        begin_s, end_s = self._due_s, self._due_s + BLOCK_S
        if until_s < end_s + LOOK_AHEAD_S and newest_s < end_s + LOOK_AHEAD_S + MAX_LATENESS_S:
            return None
        self._due_s = end_s
        return buffer.log(begin_s - WARM_UP_S, end_s + LOOK_AHEAD_S), (begin_s, end_s)

    def _take(self, log: SensorLog, span: Span) -> None:
        if self._lineariser is None:
            # A standing car shakes less than a driving one.
            if np.median(np.abs(log.odometry[:, 0])) < log.similar(MIN_SPEED):
                self.blocks_skipped += 1
                return
            self._pending.append((log, span))
            self.blocks_used += 1
            if len(self._pending) == NOISE_BLOCKS:
                self._begin()
            return
        block = self._lineariser.block(log, *span)
        if block is None:
            self.blocks_skipped += 1
            return
        assert self._statistics is not None
        self.blocks_used += 1
        self._statistics.add(block)
        self._look(span[1])

    def _begin(self) -> None:
        """Fix noise and columns, and add the blocks that waited for them."""
        pending = list(self._pending)
        self._pending.clear()
        self._sigma = np.median([log.noise() for log, _ in pending], axis=0)
        problem = prepare_residual_problem(pending[0][0], self._sigma)
        likelihood = Likelihood.of(problem, self._surrogate)
        self._layout = ColumnLayout.of(
            likelihood.nuisance_deviations(), likelihood.unobservable, likelihood.effects
        )
        self._learn_anew()
        self.blocks_used = 0
        for log, span in pending:
            self._take(log, span)

    def _learn_anew(self) -> None:
        """Start a new reference, with the effects that are known by now."""
        assert self._sigma is not None
        assert self._layout is not None
        self._lineariser = BlockLineariser(self._surrogate, self._sigma, self._layout, self.base)
        self._statistics = ChangeStatistics(self._layout)

    def _look(self, now_s: float) -> None:
        """Look for a change after a new block; begin to name it."""
        assert self._statistics is not None
        changes = [x for x in self._statistics.all_changes() if x.is_material]
        best = max(changes, key=lambda x: x.statistic, default=None)
        self.statistic = 0.0 if best is None else best.statistic
        self.likely = "" if best is None else best.candidate.effect.name
        if self._alarm_s is None:
            self._held = self._held + 1 if self.statistic > self.threshold else 0
            if self._held < HOLD_BLOCKS:
                return
            self._alarm_s, self._alarm_blocks = now_s, self._statistics.count
            self.number += 1
        if self._statistics.count - self._alarm_blocks >= self._revisions[0]:
            self._revisions.pop(0)
            if best is None or self.statistic < self.threshold:
                self._withdraw(now_s)
                return
            self._naming = name_change(self._statistics, changes)
            self._naming_until_s = now_s

    def _withdraw(self, now_s: float) -> None:
        last = self.changes[-1] if self.changes else None
        if last is not None and last.number == self.number:
            self._report(replace(last, state=WITHDRAWN, until_s=now_s))
        self._clear_alarm()

    def _continue_naming(self) -> None:
        assert self._naming is not None
        try:
            next(self._naming)
        except StopIteration as end:
            self._naming = None
            self._named(end.value)

    def _named(self, named: NamedChange) -> None:
        is_final = not self._revisions
        assert self._alarm_s is not None
        self._report(
            Change(
                self.number,
                FINAL if is_final else PRELIMINARY,
                named.verdict,
                named.best,
                named.onset_s,
                named.onset_low_s,
                named.onset_high_s,
                self._alarm_s,
                self._naming_until_s,
                self.statistic,
                self.threshold,
                named.excess_ratio,
                named.channels,
                self.buffer.start_ns or 0,
            )
        )
        if is_final:
            self.base = (*self.base, ActiveEffect(named.best.effect, named.theta))
            self._clear_alarm()
            self._learn_anew()

    def _report(self, change: Change) -> None:
        self.changes.append(change)
        self._on_change(change)
