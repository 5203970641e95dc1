# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the node does with a message, without the node: pipeline, safeguards and counters.

Whatever comes in, an exception ends here: it is counted and told, and the pipeline starts afresh.
Whatever goes out is finite: the last line of defence stands right before the publisher.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.pipeline import Pipeline, PipelineSettings
from adk_ros.model.prediction import Prediction
from adk_ros.ros.counters import Counters
from adk_ros.signals.channels import TICK_NS, Reading, Source

_MAX_BACKLOG_NS = 3 * TICK_NS // 2
_MAX_TRANSIT_NS = 10_000_000
"""How long a message may be under way before the clock may go on without it."""


class Core:
    """
    Feeds a pipeline, hands finite predictions to `publish` and counts.

    :param publish: called with each prediction, in order.
    :param tell: called with an exception that was caught, the first time only.
    :param clock: monotonic nanoseconds.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        publish: Callable[[Prediction], None],
        tell: Callable[[Exception], None],
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.pipeline = pipeline
        self.counters = Counters()
        self._publish = publish
        self._tell = tell
        self._clock = clock
        self._heard_since = False
        self._watched_ns: int | None = None

    def on_message(self, source: Source, msg: Any) -> None:
        """Take a message; publish what it completes."""
        begin_ns = self._clock()
        self.counters.heard_s[source] = begin_ns * 1e-9
        self._heard_since = True
        self._run(begin_ns, self.pipeline.take, source, msg)

    def on_timer(self, now_ns: int) -> None:
        """
        To be called every 25 ms: lets slow streams go on by the clock, and notices a stall.

        `now_ns` is the ROS clock. It moves the grid only where the stamps lag behind it though
        nothing has been heard since the last call, and that call was in time: after a stall the
        messages that it held up come first.
        """
        begin_ns = self._clock()
        since_ns = 0 if self._watched_ns is None else begin_ns - self._watched_ns
        self._watched_ns = begin_ns
        heard, self._heard_since = self._heard_since, False
        if since_ns >= 2 * TICK_NS:
            if heard or self._listening(begin_ns):
                self.counters.missed_deadlines += since_ns // TICK_NS - 1
            return
        newest_ns = self.pipeline.aligner.newest_ns
        if heard or newest_ns is None or now_ns - newest_ns < _MAX_BACKLOG_NS:
            return
        self._run(begin_ns, self.pipeline.advance, now_ns - _MAX_TRANSIT_NS)

    def reset(self) -> None:
        """Forget samples and adaptation."""
        self.counters.resets += 1
        self.pipeline.reset()

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Count an exception and start afresh: no data must end the node, whatever it hits."""
        try:
            yield
        except Exception as error:
            self.counters.internal_errors += 1
            self.counters.last_error = f"{type(error).__name__}: {error}"
            self.pipeline.reset()
            if self.counters.internal_errors == 1:
                self._tell(error)

    def _listening(self, now_ns: int) -> bool:
        heard = [heard_s for heard_s in self.counters.heard_s if heard_s is not None]
        return bool(heard) and now_ns * 1e-9 - max(heard) < 1.0

    def _run(self, begin_ns: int, work: Callable[..., list[Prediction]], *args: Any) -> None:
        pipeline, counters = self.pipeline, self.counters
        ticks = pipeline.ticks
        with self.guarded():
            for prediction in work(*args):
                self._send(prediction)
        if pipeline.ticks == ticks:
            return
        sample = pipeline.last_sample
        if sample is not None and sample.flags:
            counters.flagged[int(sample.flags)] += pipeline.ticks - ticks
        end_ns = self._clock()
        counters.note_tick((end_ns - begin_ns) * 1e-3)
        if end_ns - begin_ns > TICK_NS:
            counters.missed_deadlines += 1
            self._watched_ns = end_ns

    def _send(self, prediction: Prediction) -> None:
        finite = (
            np.isfinite(prediction.x).all()
            and np.isfinite(prediction.covariance).all()
            and np.isfinite(prediction.horizon).all()
            and np.isfinite(prediction.horizon_covariance).all()
        )
        if not finite:
            self.counters.withheld += 1
            return
        self._publish(prediction)
        self.counters.published += 1
        self.counters.note_innovation(prediction.innovation)


def warm_up(model: KoopmanModel, settings: PipelineSettings) -> None:
    """
    Drive a scratch pipeline for two seconds, so that the first real tick compiles nothing.

    Kernels are compiled, or read from their cache, on their first call: far beyond a tick.
    """
    pipeline = Pipeline(model, settings)
    for step in range(400):
        stamp_ns = 1_000_000_000 + step * 5_000_000
        swing = 0.1 * math.sin(0.05 * step)
        readings = [Reading(Source.IMU, stamp_ns, (swing, 10.0 * swing, swing))]
        if step % 4 == 0:
            readings.append(Reading(Source.ODOMETRY, stamp_ns, (10.0 + swing, 0.0, swing)))
        if step % 5 == 0:
            readings.append(Reading(Source.COMMAND, stamp_ns, (100.0 * swing, 0.1 * swing)))
        for reading in readings:
            pipeline.take_reading(reading)
    pipeline.predictor.online.condition_number()
