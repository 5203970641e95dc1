# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Evidence of one recording: a quadratic summary of its likelihood, as flat rows.

With x the joint vector of nuisance parameters and effects (see `Columns`), e the whitened
residuals of the recording at x = x0 and J their derivatives, the log-likelihood is

    l(x) = s^T (x - x0) - 1/2 (x - x0)^T H (x - x0),    s = -J^T W e,    H = J^T W J,

W being Huber's weights. It is nearly exact for effects of a small strength; for larger ones the
recording is linearised again at the estimate of the fleet. Scores of different recordings add up.

The rows hold numbers, texts and bytes (float64, little-endian, row by row), so that they go into
any table format.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from adk_ros.errors import DataError
from adk_ros.mismatch.inference.nuisances import TOLERANCE_PARAMETERS
from adk_ros.mismatch.library.catalogue import EFFECTS, effects_of
from adk_ros.mismatch.library.criteria import (
    SENSOR_OFFSET_PRIORS,
    TOLERANCE_BOUND,
    TOLERANCE_SIGMA,
    WEAK_DIRECTION_BOUND,
)
from adk_ros.mismatch.library.effect import PLACE, Effect, EffectParameter
from adk_ros.numerics.arrays import FloatArray

RECORDING, SIMULATION, PLACE_ROW = "recording", "simulation", "place"
"""Kinds of rows: a recording, the simulation itself, and a recording at one place."""
SCHEMA = 3
"""Version of the rows; rows of another one are refused."""
_BYTES = np.dtype("<f8")
Row = dict[str, Any]


@dataclass(frozen=True)
class Column:
    """A parameter of an effect as a column of the joint vector; `key` is effect.parameter."""

    effect: Effect
    parameter: EffectParameter

    @property
    def key(self) -> str:
        """Name in rows and tables."""
        return f"{self.effect.name}.{self.parameter.name}"

    @property
    def materiality(self) -> float:
        """Materiality threshold of the fitted variable: the unit of the combination."""
        threshold = self.parameter.materiality_threshold
        return 1.0 / threshold if self.parameter.inverse else threshold

    @property
    def is_one_sided(self) -> bool:
        """Whether the parameter lies on one side of neutral only, as a delay does."""
        low, high = self.bounds
        return low >= 0.0 or high <= 0.0

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the parameter's difference from neutral, in materiality thresholds."""
        p = self.parameter
        low, high = ((b - p.theta_neutral) / self.materiality for b in p.bounds())
        return low, high


def effect_columns(effects: Mapping[str, Effect] | None = None) -> tuple[Column, ...]:
    """Return the columns of all effects that may act always."""
    chosen = (e for e in (effects or EFFECTS).values() if e.activations != (PLACE,))
    return tuple(Column(effect, p) for effect in chosen for p in effect.parameters)


def place_columns(effects: Mapping[str, Effect] | None = None) -> tuple[Column, ...]:
    """Return the columns of all effects that may act at a place."""
    chosen = (e for e in (effects or EFFECTS).values() if PLACE in e.activations)
    return tuple(Column(effect, p) for effect in chosen for p in effect.parameters)


def column_of(key: str, length_scale: float = 1.0) -> Column:
    """
    Return the column with a key effect.parameter; `length_scale`: of the vehicle.

    :raises DataError: there is no such parameter.
    """
    effects = effects_of(length_scale)
    name, _, parameter = key.partition(".")
    for p in effects[name].parameters if name in effects else ():
        if p.name == parameter:
            return Column(effects[name], p)
    raise DataError(f"'{key}' is no parameter of an effect in the catalogue")


@dataclass(frozen=True)
class Columns:
    """
    Layout of the joint vector: tolerances, sensor offsets, weak directions, effects.

    `scale` (d,): size of a unit of the combination, in the unit of the fitted variable: a prior
    standard deviation of a nuisance parameter, the materiality threshold of an effect.
    `length_scale`: of the fleet's vehicles, by which thresholds and bounds of effects scale.
    """

    weak: int
    effects: tuple[str, ...]
    length_scale: float = 1.0

    @property
    def tolerances(self) -> slice:
        """Build tolerances: relative, of a car, in all its recordings."""
        return slice(0, len(TOLERANCE_PARAMETERS))

    @property
    def offsets(self) -> slice:
        """Sensor offsets."""
        first = len(TOLERANCE_PARAMETERS)
        return slice(first, first + len(SENSOR_OFFSET_PRIORS))

    @property
    def weak_directions(self) -> slice:
        """Directions that the simulation determines weakly: common to all recordings."""
        return slice(self.offsets.stop, self.offsets.stop + self.weak)

    @property
    def first_effect(self) -> int:
        """Index of the first effect."""
        return len(TOLERANCE_PARAMETERS) + len(SENSOR_OFFSET_PRIORS) + self.weak

    @property
    def size(self) -> int:
        """Length d of the joint vector."""
        return self.first_effect + len(self.effects)

    def column(self, key: str) -> Column:
        """Return the column with a key effect.parameter, of vehicles of this size."""
        return column_of(key, self.length_scale)

    @property
    def scale(self) -> FloatArray:
        """Size (d,) of a unit of the combination."""
        return np.concatenate(
            [
                np.full(len(TOLERANCE_PARAMETERS), TOLERANCE_SIGMA),
                [sigma for sigma, _ in SENSOR_OFFSET_PRIORS.values()],
                np.ones(self.weak),
                [self.column(key).materiality for key in self.effects],
            ]
        )

    @property
    def nuisance_bounds(self) -> FloatArray:
        """Symmetric bounds (k,) of the nuisance parameters, as in the analysis of a recording."""
        return np.concatenate(
            [
                np.full(len(TOLERANCE_PARAMETERS), TOLERANCE_BOUND / TOLERANCE_SIGMA),
                [bound / sigma for sigma, bound in SENSOR_OFFSET_PRIORS.values()],
                np.full(self.weak, WEAK_DIRECTION_BOUND),
            ]
        )


@dataclass(frozen=True)
class SimulationError:
    """
    What the surrogate's error resembles in further drives of the simulation.

    `vector` (d,): a joint vector, scaled; `variance` (d,): what the noise of their sensors leaves;
    `drives`: their number.
    """

    vector: FloatArray
    variance: FloatArray
    drives: int


@dataclass(frozen=True)
class Evidence:
    """
    Quadratic log-likelihood of a recording in absolute, scaled coordinates.

    `score` (d,) and `information` (d, d) refer to x = 0: l(x) = score^T x - x^T information x / 2,
    in units of `Columns.scale`. `scatter` (d, d): sum over blocks of the outer products of their
    scores, for the simulation; `blocks`: their number; `counted_s`: duration of what counts.
    """

    name: str
    kind: str
    columns: Columns
    score: FloatArray
    information: FloatArray
    counted_s: float
    start_ns: int = 0
    dispersion: float = 1.0
    """Variance of the scores between blocks over that expected of white noise, at least one."""
    loss: float = 0.0
    expected_loss: float = 0.0
    """Huber's loss where the recording was linearised, and that of a perfect model."""
    point: FloatArray | None = None
    """(d,) where it was linearised; zero if not given."""
    scatter: FloatArray | None = None
    blocks: int = 0
    error: SimulationError | None = None
    """Of the simulation, if further drives of it are known."""

    def from_origin(self, origin: FloatArray) -> Evidence:
        """Return the evidence in coordinates that count from another origin (d,)."""
        score = self.score - self.information @ origin
        return replace(self, score=score, point=self._point - origin)

    @property
    def _point(self) -> FloatArray:
        return np.zeros(self.columns.size) if self.point is None else self.point

    @property
    def loss_ratio(self) -> float:
        """Loss over that of a perfect model."""
        return self.loss / max(self.expected_loss, 1.0)

    @property
    def excess(self) -> float:
        """Loss above that of a perfect model at x = 0, by the quadratic."""
        x = self._point
        gain = 2.0 * self.score @ x - x @ self.information @ x
        return float(self.loss - self.expected_loss + gain)

    def to_row(self) -> Row:
        """Return the evidence as a flat row."""
        return {
            "schema": SCHEMA,
            "kind": self.kind,
            "recording": self.name,
            "start_ns": self.start_ns,
            "counted_s": self.counted_s,
            "weak": self.columns.weak,
            "effects": ",".join(self.columns.effects),
            "length_scale": self.columns.length_scale,
            "score": packed(self.score),
            "information": packed(self.information),
            "scatter": b"" if self.scatter is None else packed(self.scatter),
            "blocks": self.blocks,
            "dispersion": self.dispersion,
            "loss": self.loss,
            "expected_loss": self.expected_loss,
            "loss_ratio": self.loss_ratio,
            "point": packed(self._point),
            "error": b"" if self.error is None else packed(self.error.vector),
            "error_variance": b"" if self.error is None else packed(self.error.variance),
            "error_drives": 0 if self.error is None else self.error.drives,
        }

    @classmethod
    def from_row(cls, row: Row) -> Evidence:
        """
        Return the evidence of a row.

        :raises DataError: the row has another schema, or its arrays do not fit.
        """
        if row.get("schema") != SCHEMA:
            raise DataError(
                f"evidence of {row.get('recording', '?')} has schema {row.get('schema')}, "
                f"{SCHEMA} is needed: compute it again"
            )
        columns = Columns(
            int(row["weak"]), tuple(str(row["effects"]).split(",")), float(row["length_scale"])
        )
        d = columns.size
        scatter, error = row["scatter"], row["error"]
        return cls(
            name=str(row["recording"]),
            kind=str(row["kind"]),
            columns=columns,
            score=unpacked(row["score"], (d,)),
            information=unpacked(row["information"], (d, d)),
            counted_s=float(row["counted_s"]),
            start_ns=int(row["start_ns"]),
            dispersion=float(row["dispersion"]),
            loss=float(row["loss"]),
            expected_loss=float(row["expected_loss"]),
            point=unpacked(row["point"], (d,)),
            scatter=unpacked(scatter, (d, d)) if scatter else None,
            blocks=int(row["blocks"]),
            error=SimulationError(
                unpacked(error, (d,)),
                unpacked(row["error_variance"], (d,)),
                int(row["error_drives"]),
            )
            if error
            else None,
        )


def packed(values: FloatArray) -> bytes:
    """Return an array as bytes."""
    return np.ascontiguousarray(values, dtype=_BYTES).tobytes()


def unpacked(content: bytes, shape: Sequence[int]) -> FloatArray:
    """
    Return the array of a shape from bytes.

    :raises DataError: the number of bytes does not fit.
    """
    values = np.frombuffer(content, dtype=_BYTES)
    if values.size != int(np.prod(shape)):
        raise DataError(
            f"evidence has {values.size} values where {int(np.prod(shape))} are needed"
        )
    return values.reshape(shape).astype(np.float64)
