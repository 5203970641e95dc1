# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The surrogate model as a YAML file: `simulation.yaml` and `corrected.yaml`.

A file holds every parameter by name; the build tolerances identified from the recording
(relative); `terms`, effects of the catalogue with their parameters and where they act; and
`feature_terms` for unmodelled dynamics. `extras` are the simulator's own: a road profile and
feature terms. `identification` is how well the surrogate fits its simulation, which the next
analysis with this file needs.

Schema 1 called the kind `stand_in`, the feature terms `correction` and the extras `own`, and had
no `identification`; such files load as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from adk_ros.files.yaml_file import FileModel, load, read
from adk_ros.mismatch.deployment.identification_entry import IdentificationEntry
from adk_ros.mismatch.library.catalogue import EFFECTS, effects_of
from adk_ros.mismatch.library.features import feature
from adk_ros.mismatch.library.surrogate_parameters import (
    INDEX,
    SIZE,
    SURROGATE_PARAMETERS,
    default_parameters,
)
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.surrogate.activation import TRANSITION_LENGTH_M
from adk_ros.mismatch.surrogate.feature_terms import EQUATION_PARAMETERS, FeatureTerm
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.road_profile import KNOT_SPACING_M, RoadProfile
from adk_ros.mismatch.surrogate.substeps import scale_of
from adk_ros.numerics.arrays import FloatArray

KIND, SCHEMA = "surrogate", 2
_KIND_1 = "stand_in"
_UNKNOWN_ERROR_BINS = 100
"""Bins of zero residuals of a surrogate whose error is unknown."""


class ActivationEntry(FileModel):
    """
    Where a term acts.

    At a place: `stretches` (begin, end) in m along a lap of `lap` m, whose `line` has rows of
    distance, x, y (m) and heading (rad) in the frame of the recording's odometry; `edge` is the
    transition length, m. A term that acts from a time on in one recording acts throughout others.
    """

    kind: Literal["always", "place", "time"] = "always"
    onset_s: float | None = None
    lap: float | None = Field(default=None, gt=0.0, le=1e6)
    stretches: list[list[float]] = Field(default_factory=list)
    edge: float = Field(default=TRANSITION_LENGTH_M, gt=0.0, le=1e3)
    line: list[list[float]] = Field(default_factory=list)

    @model_validator(mode="after")
    def _complete(self) -> ActivationEntry:
        if self.kind == "place" and not (self.lap and self.stretches and self.line):
            raise ValueError("a place needs lap, stretches and line")
        if any(len(stretch) != 2 for stretch in self.stretches):
            raise ValueError("a stretch is [begin, end]")
        if any(len(row) != 4 for row in self.line):
            raise ValueError("a row of the line is [distance, x, y, heading]")
        return self


class EffectTermEntry(FileModel):
    """An effect of the catalogue with its parameters and activation."""

    effect: str
    parameters: dict[str, float]
    where: ActivationEntry = ActivationEntry()

    @model_validator(mode="after")
    def _known(self) -> EffectTermEntry:
        if self.effect not in EFFECTS:
            raise ValueError(f"effect '{self.effect}' is not in the catalogue")
        expected = {p.name for p in EFFECTS[self.effect].parameters}
        if set(self.parameters) != expected:
            raise ValueError(f"effect '{self.effect}' takes {', '.join(sorted(expected))}")
        return self

    def amounts(self, base: FloatArray) -> list[tuple[int, float]]:
        """Return (index, amount) pairs that the term adds to the parameters `base`."""
        return [
            pair
            for parameter in effects_of(scale_of(base))[self.effect].parameters
            for pair in parameter.amounts(parameter.theta(self.parameters[parameter.name]), base)
        ]


class FeatureTermEntry(FileModel):
    """A feature in an equation: adds `coefficient` times the feature, SI."""

    equation: Literal["v_x", "v_y", "yaw_rate", "steering"]
    feature: str
    coefficient: float

    @model_validator(mode="after")
    def _known(self) -> FeatureTermEntry:
        feature(self.feature)
        return self


class RoadEntry(FileModel):
    """
    A road profile: knots of uniform cubic B-splines, `spacing` m apart.

    The line's rows are distance, x, y (m) and heading (rad) in the frame of the odometry's pose.
    """

    line: list[list[float]] = Field(min_length=1)
    spacing: float = Field(default=KNOT_SPACING_M, gt=0.0, le=1e3)
    curves: dict[Literal["grade", "bank", "friction"], list[float]] = Field(min_length=1)

    @model_validator(mode="after")
    def _complete(self) -> RoadEntry:
        if any(len(row) != 4 for row in self.line):
            raise ValueError("a row of the line is [distance, x, y, heading]")
        if len({len(knots) for knots in self.curves.values()}) != 1:
            raise ValueError("all curves need the same number of knots")
        if min(len(knots) for knots in self.curves.values()) < 4:
            raise ValueError("a curve needs at least four knots")
        return self

    def profile(self) -> RoadProfile:
        """Return the road profile."""
        return RoadProfile(
            np.array(self.line),
            tuple(self.curves),
            np.array(list(self.curves.values())),
            self.spacing,
        )


class SimulatorExtras(FileModel):
    """Parts of the simulator beyond the surrogate's parameters."""

    road: RoadEntry | None = None
    feature_terms: list[FeatureTermEntry] = Field(default_factory=list)


class SurrogateFile(FileModel):
    """The content of `simulation.yaml` and `corrected.yaml`."""

    kind: Literal["surrogate"]
    schema_version: Literal[2] = Field(default=2, alias="schema")
    parameters: dict[str, float]
    tolerances: dict[str, float] = Field(default_factory=dict)
    terms: list[EffectTermEntry] = Field(default_factory=list)
    feature_terms: list[FeatureTermEntry] = Field(default_factory=list)
    extras: SimulatorExtras = SimulatorExtras()
    identification: IdentificationEntry | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_schema_1(cls, content: Any) -> Any:
        if not isinstance(content, dict) or content.get("kind") != _KIND_1:
            return content
        if content.get("schema", 1) != 1:
            raise ValueError(f"a file of kind '{_KIND_1}' has schema 1")
        out = {**content, "kind": KIND, "schema": SCHEMA}
        if "correction" in out:
            out["feature_terms"] = out.pop("correction")
        if "own" in out:
            extras = out.pop("own")
            if isinstance(extras, dict) and "correction" in extras:
                extras = dict(extras)
                extras["feature_terms"] = extras.pop("correction")
            out["extras"] = extras
        return out

    @model_validator(mode="after")
    def _names(self) -> SurrogateFile:
        for name in (*self.parameters, *self.tolerances):
            if name not in INDEX:
                raise ValueError(f"parameter '{name}' is unknown")
        for name, value in self.parameters.items():
            entry = SURROGATE_PARAMETERS[name]
            if not entry.low <= value <= entry.high:
                raise ValueError(f"{name} must be {entry.low:g} to {entry.high:g}, got {value:g}")
        return self

    def vector(self) -> FloatArray:
        """Return the parameters (SIZE,) with the tolerances, without the terms."""
        p = default_parameters()
        for name, value in self.parameters.items():
            p[INDEX[name]] = value
        for name, share in self.tolerances.items():
            p[INDEX[name]] *= 1.0 + share
        return p

    def vector_with_terms(self) -> FloatArray:
        """Return the parameters (SIZE,) with all terms that do not depend on position."""
        base = self.vector()
        p: FloatArray = base.copy()
        for term in self.terms:
            if term.where.kind != "place":
                for i, size in term.amounts(base):
                    p[i] += size
        return p

    def feature_coefficients(self) -> tuple[list[str], FloatArray]:
        """Return all features, and their coefficients (k, 4), see `RunInputs.extra`."""
        terms = [*self.extras.feature_terms, *self.feature_terms]
        names = sorted({term.feature for term in terms})
        equations = list(EQUATION_PARAMETERS)
        table = np.zeros((len(names), len(equations)))
        for term in terms:
            table[names.index(term.feature), equations.index(term.equation)] += term.coefficient
        return names, table

    def road(self) -> RoadProfile | None:
        """Return the profile of the simulator's road, if it was identified."""
        return None if self.extras.road is None else self.extras.road.profile()

    def surrogate(self) -> SurrogateModel:
        """
        Return the surrogate of the simulator, without terms identified from a recording.

        Its error is zero, and its residuals are, where the file holds no `identification`.
        """
        features = tuple(
            FeatureTerm(c.equation, c.feature, c.coefficient, 0.0)
            for c in self.extras.feature_terms
        )
        entry = self.identification
        if entry is None:
            unknown = np.zeros((len(CHANNELS), _UNKNOWN_ERROR_BINS))
            return SurrogateModel(
                self.vector(),
                np.zeros(len(CHANNELS)),
                unknown,
                np.empty((0, SIZE)),
                self.road(),
                features,
            )
        return SurrogateModel(
            self.vector(),
            entry.errors(),
            np.empty((len(CHANNELS), 0)),
            entry.directions(),
            self.road(),
            features,
            autocovariance=entry.error_autocovariance(),
            open_loop_error=entry.open_loop_errors(),
            envelope=entry.acceleration_envelope(),
        )


@dataclass(frozen=True)
class NamedSurrogate:
    """A loaded file, with its name for messages."""

    name: str
    content: SurrogateFile


def is_surrogate_file(path: Path) -> bool:
    """
    Whether a YAML file describes a surrogate and not a vehicle.

    Raises `UsageError` for a file that cannot be read.
    """
    return path.is_file() and read(path, "model")[1].get("kind") in {KIND, _KIND_1}


def load_surrogate(path: Path) -> NamedSurrogate:
    """
    Load a surrogate's YAML file.

    Raises `UsageError`, one line naming the file and the key.
    """
    return NamedSurrogate(path.name, load(path, "surrogate", SurrogateFile))
