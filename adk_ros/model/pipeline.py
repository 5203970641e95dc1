# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Message in, predictions out: decode -> align -> predict.

The live node, the replay and the benchmarks run this same code, so a replay of a bag reproduces
what the live node published.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.initial_errors import one_step_errors, tick_change
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.planned_horizon import PlannedHorizon
from adk_ros.model.prediction import Prediction, Status
from adk_ros.model.predictor import Predictor
from adk_ros.signals.absent_command import absent_command
from adk_ros.signals.align import Aligner
from adk_ros.signals.channels import TICK_NS, Flag, Reading, Sample, Source
from adk_ros.signals.command_plan import PlanDecoder
from adk_ros.signals.decode import Decoder, RefusedMessage, SensorConfig
from adk_ros.signals.gate import GateSettings, ReadingGate
from adk_ros.signals.plausibility import Plausibility

_TICK_S = TICK_NS * 1e-9
_RESTART, _LEVEL_CHANGE = int(Flag.RESTART), int(Flag.LEVEL_CHANGE)
_ODOMETRY = Source.ODOMETRY


@dataclass(frozen=True)
class PipelineSettings:
    """
    Settings of a pipeline apart from the model.

    `online`: settings of the online method; None: the model's own. `horizon_steps`: of 25 ms.
    Times in seconds: an odometry gap longer than `odometry_timeout_s` is coasted for up to
    `max_coast_s`; a repeated reading counts as frozen after `frozen_after_s`; a stream is waited
    for up to `max_wait_s`; a plan of commands is followed up to the age `plan_timeout_s`.
    `has_command`: False for a recording without commands, see `signals.absent_command`.
    """

    sensors: SensorConfig = field(default_factory=SensorConfig)
    online: OnlineSettings | None = None
    horizon_steps: int = 80
    odometry_timeout_s: float = 0.5
    frozen_after_s: float = 1.0
    max_wait_s: float = 0.05
    max_coast_s: float = 1.0
    plan_timeout_s: float = 0.5
    gate: GateSettings = field(default_factory=GateSettings)
    has_command: bool = True


class Pipeline:
    """
    Turns messages into predictions and counts events.

    `last_sample` and `last_prediction` are the newest. Diagnostics read `predictor`, `aligner`,
    `gate`, `decoder` and `plausibility`.
    """

    def __init__(self, model: KoopmanModel, settings: PipelineSettings | None = None) -> None:
        settings = settings or PipelineSettings()
        self.settings = settings
        self.decoder = Decoder(settings.sensors)
        errors = np.diag(one_step_errors(model))
        self.gate = ReadingGate(tick_change(model), errors, settings.gate)
        self.aligner = Aligner(
            odometry_timeout_s=settings.odometry_timeout_s,
            frozen_after_s=settings.frozen_after_s,
            max_wait_s=settings.max_wait_s,
            gate=self.gate if settings.gate.false_rejection else None,
        )
        self.predictor = Predictor(
            model,
            settings.online,
            horizon_steps=settings.horizon_steps,
            max_coast_steps=round(settings.max_coast_s / _TICK_S),
            withhold_implausible=True,
        )
        self.planned = PlannedHorizon(model, settings.horizon_steps, settings.plan_timeout_s)
        self.plan_decoder = PlanDecoder(settings.sensors)
        self.plausibility = Plausibility(settings.sensors.reference_point, settings.has_command)
        # A list: an enum as dictionary key is hashed in Python, eight times per tick.
        self._received = [0] * len(Source)
        self.ticks = 0
        self.restarts = 0
        self.flagged: Counter[int] = Counter()
        """Samples by their flags, of those that have any."""
        self.last_sample: Sample | None = None
        self.last_prediction: Prediction | None = None

    @property
    def received(self) -> Counter[Source]:
        """Number of messages by source."""
        return Counter({s: n for s, n in zip(Source, self._received, strict=True) if n})

    def set_sensors(self, sensors: SensorConfig) -> None:
        """Read all further messages with another sensor configuration; begin afresh."""
        refused = self.decoder.refused
        self.settings = replace(self.settings, sensors=sensors)
        self.decoder = Decoder(sensors)
        self.decoder.refused = refused
        plans, self.plan_decoder = self.plan_decoder, PlanDecoder(sensors)
        self.plan_decoder.refused, self.plan_decoder.received = plans.refused, plans.received
        self.reset()

    def each(self, source: Source, msg: Any) -> Iterator[Prediction]:
        """
        Take a message; yield the predictions of the ticks that it completes, often none.

        Each is made when it is asked for: until the next one, `last_sample` and `predictor` are
        those of its tick. All must be asked for before the next call.
        """
        self._received[source] += 1
        try:
            reading = self.decoder.decode(source, msg)
        except RefusedMessage:
            return
        yield from self._each_of(reading)

    def each_until(self, now_ns: int) -> Iterator[Prediction]:
        """Complete the ticks that are due at `now_ns`, see `Aligner.advance`; yield as `each`."""
        return self._predict(self.aligner.advance(now_ns))

    def take(self, source: Source, msg: Any) -> list[Prediction]:
        """Take a message; return the predictions of the ticks that it completes, often none."""
        return list(self.each(source, msg))

    def take_reading(self, reading: Reading) -> list[Prediction]:
        """Take a decoded reading; return as `take`."""
        return list(self._each_of(reading))

    def _each_of(self, reading: Reading) -> Iterator[Prediction]:
        if reading.source is _ODOMETRY:
            self.plausibility.see(reading)
            if not self.settings.has_command:
                yield from self._predict(self.aligner.take(reading))
                reading = absent_command(reading)
        samples = self.aligner.take(reading)
        if samples:
            yield from self._predict(samples)

    def take_plan(self, msg: Any) -> None:
        """Follow the planned commands of a message; a refused one leaves the plan before it."""
        with contextlib.suppress(RefusedMessage):
            self.planned.take(self.plan_decoder.decode(msg, self.aligner.newest_ns))

    def reset(self) -> None:
        """Forget samples and adaptation; keep the counts."""
        self.decoder.reset()
        self.aligner.reset()
        self.gate.reset()
        self.predictor.reset()
        self.planned.reset()
        self.plausibility.reset()

    def _predict(self, samples: Iterable[Sample]) -> Iterator[Prediction]:
        for sample in samples:
            self.ticks += 1
            if sample.flags:
                self.flagged[int(sample.flags)] += 1
            if sample.flags & _RESTART:
                self.restarts += 1
                self.decoder.reset()
                self.planned.restart(sample.stamp_ns)
            if sample.flags & _LEVEL_CHANGE:
                self.planned.interrupt()
            self.last_sample = sample
            self.plausibility.add(sample)
            prediction = self.predictor.step(sample)
            if prediction is None:
                if self.predictor.status is not Status.IMPLAUSIBLE:
                    self.gate.forget()
                self.planned.interrupt()
                continue
            self.gate.expect(
                sample.stamp_ns,
                self.predictor.present_state,
                prediction.x,
                self.predictor.uncertainty_growth,
            )
            prediction = self.planned.apply(self.predictor, prediction, sample)
            self.last_prediction = prediction
            yield prediction
