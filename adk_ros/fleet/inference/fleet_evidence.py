# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Evidence of all recordings of a fleet, with the car, the time and the tags of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from adk_ros.errors import DataError
from adk_ros.fleet.inference.evidence import (
    RECORDING,
    SIMULATION,
    Columns,
    Evidence,
    Row,
    SimulationError,
)
from adk_ros.fleet.inference.shared_error import remaining_error, shared_error
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class RecordingTags:
    """Car of a recording, its time in days on any scale, and further tags, name -> value."""

    car: str
    day: float = 0.0
    tags: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class FleetEvidence:
    """
    Evidence of r recordings in common columns (d).

    `scores` (r, d) and `informations` (r, d, d), already divided by the dispersion of each
    recording. `bias` (d, d): covariance of the score that the surrogate's error leaves in the
    whole simulation; `bias_blocks`: blocks that it was estimated from; `shares` (r,): duration of
    a recording over that of the simulation.
    """

    columns: Columns
    names: tuple[str, ...]
    scores: FloatArray
    informations: FloatArray
    cars: tuple[str, ...]
    days: FloatArray
    tags: tuple[Mapping[str, str], ...]
    shares: FloatArray
    bias: FloatArray
    bias_blocks: int
    excess: FloatArray
    """(r,) loss above that of a perfect model without any effect, by the quadratics."""
    expected_loss: FloatArray
    """(r,) loss of a perfect model."""
    is_at_estimate: bool = False
    """Whether the recordings are linearised at an estimate of their effects."""
    error: SimulationError | None = None
    """What the surrogate's error resembles: the joint vector from which all others count."""

    @property
    def origin(self) -> FloatArray:
        """Joint vector (d,) from which those of the recordings count."""
        return np.zeros(self.columns.size) if self.error is None else self.error.vector

    def without_error(self) -> FleetEvidence:
        """Return the evidence as it is without further drives of the simulation."""
        score = self.scores + self.informations @ self.origin
        gain = (self.scores + score) @ self.origin
        return replace(self, scores=score, excess=self.excess + gain, error=None)

    def systematic_deviation(self, effect: int) -> float:
        """
        Return the deviation of an effect of all cars that no number of recordings lowers.

        In materiality thresholds: what the surrogate's error on other roads feigns, or what is
        left of that where further drives of the simulation show it.
        """
        key = self.columns.effects[effect]
        if self.error is None:
            return shared_error(key)
        of_noise = float(self.error.variance[self.columns.first_effect + effect])
        return float(np.hypot(remaining_error(key), np.sqrt(of_noise)))

    @classmethod
    def of(cls, rows: Sequence[Row], tags: Mapping[str, RecordingTags]) -> FleetEvidence:
        """
        Return the evidence of rows; those of recordings without tags are cars of their own.

        :raises DataError: no recordings, or rows with different columns.
        """
        every = [Evidence.from_row(row) for row in rows if row["kind"] in {RECORDING, SIMULATION}]
        recordings = [one for one in every if one.kind == RECORDING]
        if not recordings:
            raise DataError("no recording of the fleet has evidence: nothing to combine")
        columns = recordings[0].columns
        for one in every:
            if one.columns != columns:
                raise DataError(
                    f"evidence of {one.name} is about other effects, or another surrogate, than "
                    f"that of {recordings[0].name}: compute both with one simulation"
                )
        known = [tags.get(one.name, RecordingTags(one.name)) for one in recordings]
        simulated = [one for one in every if one.kind == SIMULATION and one.scatter is not None]
        error = simulated[0].error if simulated else None
        if error is not None:
            recordings = [one.from_origin(error.vector) for one in recordings]
        bias, blocks = np.zeros((columns.size, columns.size)), 1
        shares = np.zeros(len(recordings))
        if simulated:
            assert simulated[0].scatter is not None
            bias, blocks = simulated[0].scatter, simulated[0].blocks
            shares = np.array([one.counted_s for one in recordings]) / simulated[0].counted_s
        dispersion = np.array([one.dispersion for one in recordings])
        return cls(
            columns,
            tuple(one.name for one in recordings),
            np.array([one.score for one in recordings]) / dispersion[:, None],
            np.array([one.information for one in recordings]) / dispersion[:, None, None],
            tuple(one.car for one in known),
            np.array([one.day for one in known]),
            tuple(one.tags for one in known),
            shares / dispersion,
            bias,
            blocks,
            np.array([one.excess for one in recordings]) / dispersion,
            np.array([one.expected_loss for one in recordings]) / dispersion,
            error=error,
        )

    @property
    def car_names(self) -> list[str]:
        """Names of the cars, sorted."""
        return sorted(set(self.cars))

    def effective_cars(self, effect: int) -> float:
        """
        Return how many cars with the same information say as much on the mean of an effect.

        (sum w)^2 / sum w^2, w being a car's information. Recordings whose car is not known may be
        of the car with most of it.
        """
        at = self.columns.first_effect + effect
        of_car: dict[str, float] = {}
        unknown = 0.0
        for name, car, w in zip(self.names, self.cars, self.informations[:, at, at], strict=True):
            if is_known_car(car, name):
                of_car[car] = of_car.get(car, 0.0) + float(w)
            else:
                unknown += float(w)
        weights = np.sort(list(of_car.values()) or [0.0])
        weights[-1] += unknown
        squares = float((weights**2).sum())
        return float(weights.sum()) ** 2 / squares if squares > 0.0 else 1.0

    def kept(self, rows: Sequence[int]) -> FleetEvidence:
        """Return the evidence of some of the recordings."""
        at = np.asarray(rows, dtype=np.int64)
        return replace(
            self,
            names=tuple(self.names[i] for i in at),
            scores=self.scores[at],
            informations=self.informations[at],
            cars=tuple(self.cars[i] for i in at),
            days=self.days[at],
            tags=tuple(self.tags[i] for i in at),
            shares=self.shares[at],
            excess=self.excess[at],
            expected_loss=self.expected_loss[at],
        )


def is_known_car(car: str, recording: str) -> bool:
    """Whether it is known which car a recording is of; else the car has its name."""
    return car != recording
