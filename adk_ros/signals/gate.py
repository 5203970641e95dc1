# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Innovation gate: reject single readings that contradict the prediction, and accept new levels.

Each channel of an IMU or odometry reading is compared with the value that the last prediction
gives for its stamp (linear between the tick and the predicted one). With the innovation e,

    e^2 / (s^2 + c^2 + g) > chi2(1 - p)     for any channel rejects the reading.

s^2 is the mean square of the innovations accepted so far, c the RMS change of the state over one
tick in the training data (what a vehicle does without being predicted is no fault), and g what is
added while predictions are uncertain. A message that reports a larger variance than it used to
adds the difference. p is the share of good readings that is rejected if innovations are normal.

After `confirmations` rejected readings in succession it is not single readings that are wrong. If
they agree with each other, their level is accepted: the vehicle or the sensor has changed. The
predictor takes over new velocities; an offset of the specific force, as of a tilted IMU, is kept
here, added to what is expected, and follows the innovations from then on. If they do not agree,
s^2 becomes their mean square: the noise has grown.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS, Reading, Source
from adk_ros.signals.gate_kernel import (
    ACCEPTED,
    MAX_BATCH,
    NEW_LEVEL,
    REJECTED,
    GateState,
    judge_readings,
    set_expectation,
)

CHANNELS = {
    Source.IMU: (("a_x", "m/s²"), ("a_y", "m/s²"), ("yaw_rate", "rad/s")),
    Source.ODOMETRY: (("v_x", "m/s"), ("v_y", "m/s"), ("yaw_rate", "rad/s")),
}
"""Tested streams, and name and unit of their channels."""
_MIN_VARIANCE = 1e-12
"""SI units squared; only a guard against a division by zero."""


@dataclass(frozen=True)
class GateSettings:
    """
    `false_rejection`: p above, 0 to switch the gate off; `confirmations` of a change.

    :raises UsageError: a value is out of range.
    """

    false_rejection: float = 1e-6
    confirmations: int = 5

    def __post_init__(self) -> None:
        if not 0.0 <= self.false_rejection <= 0.1:
            raise UsageError(f"gate_false_rejection is {self.false_rejection}: choose 0 to 0.1")
        if not 2 <= self.confirmations <= 1000:
            raise UsageError(f"gate_confirmations is {self.confirmations}: choose 2 to 1000")


class Rejection(NamedTuple):
    """A rejected reading: its channel that deviates most from the expectation, SI units."""

    source: Source
    channel: str
    unit: str
    stamp_ns: int
    value: float
    expected: float
    bound: float
    """Largest deviation that would have been accepted."""

    def __str__(self) -> str:
        return (
            f"{self.channel} {self.value:.4g} {self.unit}, expected {self.expected:.4g} "
            f"± {self.bound:.2g} {self.unit}"
        )


class ReadingGate:
    """
    Judges the readings of one pipeline.

    By source, `rejected` counts rejected readings, `level_changes` accepted new levels and
    `noise_changes` cases of grown noise; `latest` has the latest rejection.

    :param change: RMS change (3,) of v_x, v_y and yaw rate over one tick, SI.
    :param errors: initial mean square (3,) of their innovations, SI units squared.
    """

    def __init__(
        self, change: FloatArray, errors: FloatArray, settings: GateSettings | None = None
    ) -> None:
        settings = settings or GateSettings()
        self._confirmations = settings.confirmations
        p = settings.false_rejection
        self._chi2 = NormalDist().inv_cdf(1.0 - 0.5 * p) ** 2 if p else math.inf
        square = np.maximum(np.square(change), _MIN_VARIANCE)
        # A force changes by as much as a velocity does in a tick, divided by the tick.
        tick_s = np.array([TICK_NS * 1e-9, TICK_NS * 1e-9, 1.0])
        self._floor = np.array([square / tick_s**2, square])
        # Nothing is known of the forces: their noise is adopted after a few readings.
        self._errors = np.array([[0.0, 0.0, errors[2]], errors])
        self.rejected: Counter[Source] = Counter()
        self.level_changes: Counter[Source] = Counter()
        self.noise_changes: Counter[Source] = Counter()
        self.latest: dict[Source, Rejection] = {}
        self.reset()

    def reset(self) -> None:
        """Forget statistics and expectation; keep the counts."""
        self._state = GateState(self._errors, self._floor, self._confirmations)
        self._begin_ns: int | None = None
        self.forget()

    def forget(self) -> None:
        """Accept all readings until the next prediction."""
        self._tick_ns: int | None = None
        self.level_changed = False

    def expect(
        self, tick_ns: int, state: FloatArray, predicted: FloatArray, growth: FloatArray
    ) -> None:
        """
        Take over the `state` (3,) at a tick and the one `predicted` (3,) for the next, SI.

        `growth` (3,): variance added because the prediction is uncertain, SI units squared.
        """
        self._tick_ns = tick_ns
        self.level_changed = False
        set_expectation(state, predicted, growth, self._state.rows)

    def accepts(self, reading: Reading) -> bool:
        """Return whether `rejects` leaves a reading in."""
        return not self.rejects([reading])

    def rejects(self, readings: Sequence[Reading]) -> Sequence[Reading]:
        """
        Return those of the readings, of IMU or odometry, that may not be used.

        Each stream's are in order of their stamps, also from call to call. A channel that is NaN
        is not tested.
        """
        tick_ns = self._tick_ns
        if tick_ns is None or not readings:
            return ()
        if self._begin_ns is None:
            self._begin_ns = readings[0].stamp_ns
        begin_ns, state = self._begin_ns, self._state
        found: list[Reading] = []
        for first in range(0, len(readings), MAX_BATCH):
            batch = readings[first : first + MAX_BATCH]
            for i, reading in enumerate(batch):
                stamp_ns = reading.stamp_ns
                state.pack(i, reading, (stamp_ns - tick_ns) * 1e-9, (stamp_ns - begin_ns) * 1e-9)
            if judge_readings(len(batch), self._chi2, state.rows):
                found += self._account(batch)
        return found

    def _account(self, batch: Sequence[Reading]) -> list[Reading]:
        """Count what was not simply accepted; return the rejected readings."""
        rejected = []
        outcomes: list[list[float]] = self._state.outcome[: len(batch)].tolist()
        for reading, (decision, channel, innovation, bound) in zip(batch, outcomes, strict=True):
            source = reading.source
            if decision == ACCEPTED:
                continue
            if decision == REJECTED:
                self.rejected[source] += 1
                self.latest[source] = _rejection(reading, int(channel), innovation, bound)
                rejected.append(reading)
            elif decision == NEW_LEVEL:
                self.level_changes[source] += 1
                self.level_changed = True
            else:
                self.noise_changes[source] += 1
        return rejected


def _rejection(reading: Reading, channel: int, innovation: float, bound: float) -> Rejection:
    name, unit = CHANNELS[reading.source][channel]
    value = reading.values[channel]
    return Rejection(
        reading.source, name, unit, reading.stamp_ns, value, value - innovation, bound
    )
