# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Process messages and timer calls without ROS: pipeline, exception handling, counters.

An exception in the pipeline is caught here: it is counted and reported, and the pipeline is
reset. Predictions that are not finite are withheld right before the publisher.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.pipeline import Pipeline, PipelineSettings
from adk_ros.model.prediction import Prediction
from adk_ros.model.rollout_requests import RefusedRequest, RolloutRequests
from adk_ros.ros.counters import Counters
from adk_ros.signals.channels import TICK_NS, Flag, Reading, Source
from adk_ros.signals.command_plan import CommandPlan
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.extrinsics import frame_of
from adk_ros.signals.message_checks import message_warnings
from adk_ros.signals.stamps import StampMonitor

_MAX_BACKLOG_NS = 3 * TICK_NS // 2
"""ns that the newest stamp may lag the ROS clock before the clock completes samples: 1.5 samples,
so that streams with a message per sample never need it."""

_MAX_TRANSIT_NS = 10_000_000
"""ns granted to a message, beyond the smallest delay of recent ones, before the clock passes its
stamp. Transport within one computer takes less than 1 ms; the rest covers the sensor's driver."""

_MAX_DELAY_NS = 1_000_000_000
"""Largest delay of the messages that is considered, ns; beyond, their clock is another one."""

_OLDEST_S = 0.5
"""s since the latest prediction within which requests are answered from it. By choice: a car that
brakes hard changes its speed by 5 m/s meanwhile; streams of 5 Hz still have two messages."""

_RECENT_S = 1.0
"""s since the last message within which a late timer call counts as a missed deadline; without
input there is no deadline."""


class Core:
    """
    Feed a pipeline, pass finite predictions to `publish`, and count.

    :param publish: called with each prediction, in order.
    :param on_error: called with the first exception that is caught.
    :param clock: returns monotonic time in nanoseconds.
    :param frame_id: frame of the predictions, to compare with that of odometry.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        publish: Callable[[Prediction], None],
        on_error: Callable[[Exception], None],
        clock: Callable[[], int] = time.monotonic_ns,
        frame_id: str = "",
    ) -> None:
        self.pipeline = pipeline
        self.rollouts = RolloutRequests(pipeline)
        self.counters = Counters()
        self.stamps = StampMonitor()
        self._publish = publish
        self._on_error = on_error
        self._clock = clock
        self._received_since_timer = False
        self._last_timer_ns: int | None = None
        self.enabled = True
        self._frame_id = frame_id
        self._is_shifted = any(pipeline.settings.sensors.reference_point)
        self._unchecked = [True for _ in Source]
        self._message_warnings: list[list[str]] = [[] for _ in Source]
        self.frames: dict[Source, str] = {}
        """Frame of the values of IMU and odometry, as a checked message names it."""
        self.on_frames: Callable[[], None] = _ignore
        """Called when a message has named a frame."""

    def on_message(self, source: Source, msg: Any) -> None:
        """Process a message; publish the predictions that it completes."""
        begin_ns = self._clock()
        self.counters.last_received_s[source] = begin_ns * 1e-9
        if not self.enabled:
            return
        self._received_since_timer = True
        self._run(begin_ns, self.pipeline.each, source, msg)
        stamp_ns = self.pipeline.decoder.latest_ns
        if stamp_ns is not None:
            # Compared as they are used: a delay that is known is corrected.
            self.stamps.see(source, stamp_ns - self.sensors.delays_ns[source], begin_ns)
        if self._unchecked[source]:
            self._unchecked[source] = False
            with self.guarded():
                self._message_warnings[source] = message_warnings(
                    source, msg, self._frame_id, is_shifted=self._is_shifted
                )
                if source <= Source.ODOMETRY:
                    self.frames[source] = frame_of(msg)
                    self.on_frames()

    def on_plan(self, msg: Any) -> None:
        """Take planned commands, which the horizons after it follow."""
        if self.enabled:
            with self.guarded():
                self.pipeline.take_plan(msg)

    @property
    def sensors(self) -> SensorConfig:
        """The configuration that messages are read with."""
        return self.pipeline.settings.sensors

    def set_sensors(self, sensors: SensorConfig) -> None:
        """Read all further messages with another configuration; begin afresh."""
        self.pipeline.set_sensors(sensors)

    def message_warnings(self) -> list[str]:
        """Return what is wrong with the latest checked messages; have the next ones checked."""
        self._unchecked = [True for _ in Source]
        return [text for texts in self._message_warnings for text in texts]

    def on_timer(self, now_ns: int) -> None:
        """
        Complete samples by the clock if streams are slow, and count stalls; call every 25 ms.

        `now_ns` is the ROS clock. It completes samples only if the stamps lag behind it, no
        message arrived since the last call, and that call was on time: after a stall, the
        messages that queued up are processed first.
        """
        begin_ns = self._clock()
        elapsed_ns = 0 if self._last_timer_ns is None else begin_ns - self._last_timer_ns
        self._last_timer_ns = begin_ns
        if not self.enabled:
            return
        received, self._received_since_timer = self._received_since_timer, False
        if elapsed_ns >= 2 * TICK_NS:
            if received or self._has_input(begin_ns):
                self.counters.missed_deadlines += elapsed_ns // TICK_NS - 1
            return
        newest_ns = self.pipeline.aligner.newest_ns
        if received or newest_ns is None or now_ns - newest_ns < _MAX_BACKLOG_NS:
            return
        # In the time of the stamps: the delay of the arrivals, in the clock that `now_ns` is of.
        delay_ns = (self.stamps.least_delay_ns(begin_ns) or 0) + now_ns - begin_ns
        if delay_ns > _MAX_DELAY_NS:
            # Another clock: it says nothing on how far the vehicle has got.
            return
        transit_ns = _MAX_TRANSIT_NS + max(delay_ns, 0)
        self._run(begin_ns, self.pipeline.each_until, now_ns - transit_ns)

    def outdated(self) -> str:
        """Return why the latest prediction is not of the vehicle as it is, "" if it is."""
        if not self.enabled:
            return "the node is disabled"
        published_s = self.counters.last_published_s
        if published_s is None:
            return "no prediction yet"
        age_s = self._clock() * 1e-9 - published_s
        return "" if age_s <= _OLDEST_S else f"the last prediction is {age_s:.1f} s old"

    def enable(self, enabled: bool) -> None:
        """Ignore all messages from now on, or begin afresh."""
        if enabled and not self.enabled:
            self.pipeline.reset()
        self.enabled = enabled

    def reset(self) -> None:
        """Discard samples and adaptation."""
        self.counters.resets += 1
        self.pipeline.reset()

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Count an exception and reset the pipeline: no data must end the node."""
        try:
            yield
        except Exception as error:
            self._recover(error)

    def _recover(self, error: Exception) -> None:
        self.counters.internal_errors += 1
        self.counters.last_error = f"{type(error).__name__}: {error}"
        self.pipeline.reset()
        if self.counters.internal_errors == 1:
            self._on_error(error)

    def _has_input(self, now_ns: int) -> bool:
        """Return whether any message arrived within the last second."""
        received = [time_s for time_s in self.counters.last_received_s if time_s is not None]
        return bool(received) and now_ns * 1e-9 - max(received) < _RECENT_S

    def _run(self, begin_ns: int, work: Callable[..., Iterator[Prediction]], *args: Any) -> None:
        pipeline, counters = self.pipeline, self.counters
        ticks, published = pipeline.ticks, counters.published
        # As `guarded`, without its generator: this runs for every message.
        try:
            for prediction in work(*args):
                self._publish_if_finite(prediction)
        except Exception as error:
            self._recover(error)
        if counters.published > published:
            counters.last_published_s = begin_ns * 1e-9
        if pipeline.ticks == ticks:
            return
        end_ns = self._clock()
        counters.note_tick((end_ns - begin_ns) * 1e-3)
        if end_ns - begin_ns > TICK_NS:
            counters.missed_deadlines += 1
            self._last_timer_ns = end_ns

    def _publish_if_finite(self, prediction: Prediction) -> None:
        if not prediction.is_finite():
            self.counters.withheld += 1
            return
        self._publish(prediction)
        self.counters.published += 1
        self.counters.note_innovation(prediction.innovation)


def _ignore() -> None:
    """Do nothing."""


def _straight_plan(stamp_ns: int) -> CommandPlan:
    times_ns = stamp_ns + TICK_NS * np.arange(80, dtype=np.int64)
    return CommandPlan(stamp_ns, times_ns, np.zeros((80, 2)))


def warm_up(model: KoopmanModel, settings: PipelineSettings) -> None:
    """
    Run a temporary pipeline on 2 s of synthetic readings, so that all kernels are compiled.

    Kernels are compiled, or read from their cache, on their first call, which takes far longer
    than the 25 ms of a sample.
    """
    pipeline = Pipeline(model, settings)
    predictions: list[Prediction] = []
    for step in range(400):
        stamp_ns = 1_000_000_000 + step * 5_000_000
        sway = 0.1 * math.sin(0.05 * step)
        readings = [Reading(Source.IMU, stamp_ns, (sway, 10.0 * sway, sway))]
        if step % 4 == 0:
            readings.append(Reading(Source.ODOMETRY, stamp_ns, (10.0 + sway, 0.0, sway)))
        if step % 5 == 0:
            readings.append(Reading(Source.COMMAND, stamp_ns, (100.0 * sway, 0.1 * sway)))
        for reading in readings:
            predictions += pipeline.take_reading(reading)
        if step == 200:
            pipeline.planned.take(_straight_plan(stamp_ns))
    for prediction in predictions[-1:]:
        prediction.is_finite()
        # An encoder without compiled form has no derivatives.
        with suppress(UsageError):
            pipeline.predictor.linearized(np.zeros((1, 2)))
        with suppress(RefusedRequest):
            RolloutRequests(pipeline).answer((1, 1, 2), np.zeros(2))
    pipeline.predictor.online.condition_number()
    # Later, odometry may be lost: what predictions go on with is compiled as well.
    if pipeline.last_sample is not None:
        lost = pipeline.last_sample
        stamp_ns, flags = lost.stamp_ns + TICK_NS, lost.flags | int(Flag.COASTING)
        pipeline.predictor.step(lost._replace(stamp_ns=stamp_ns, flags=flags))
