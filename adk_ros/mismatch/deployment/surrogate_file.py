# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The stand-in as a YAML file, with the terms that were found, and back.

A file holds every entry of the parameter vector by name; the build tolerances that the recording
showed (relative); terms, each an effect of the catalogue with its parameters and where it acts;
and a correction by features, for what no effect explains. What the simulator itself has beyond the
model family is `own`: curves along its road, and a correction by features of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml  # type: ignore[import-untyped, unused-ignore]
from pydantic import Field, model_validator

from adk_ros.files.yaml_file import FileModel, load, read
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.features import FEATURES
from adk_ros.mismatch.library.surrogate_parameters import (
    INDEX,
    NAMES,
    SIZE,
    SURROGATE_PARAMETERS,
    default_parameters,
)
from adk_ros.mismatch.surrogate.activation import TRANSITION_LENGTH_M
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.road_profile import KNOT_SPACING_M, RoadProfile
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES

KIND = "stand_in"


class ActivationEntry(FileModel):
    """
    Where a term acts.

    At a place: stretches (begin, end) in m along a lap, whose line is given as rows of distance,
    x, y (m) and heading (rad) in the frame of the recording's odometry; `edge` is how gradually it
    begins, m. From a time on, a term
    found in one recording acts throughout any other.
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
    """An effect of the catalogue at work."""

    effect: str
    parameters: dict[str, float]
    where: ActivationEntry = ActivationEntry()

    @model_validator(mode="after")
    def _known(self) -> EffectTermEntry:
        if self.effect not in EFFECTS:
            raise ValueError(f"effect '{self.effect}' is not in the catalogue")
        wanted = {p.name for p in EFFECTS[self.effect].parameters}
        if set(self.parameters) != wanted:
            raise ValueError(f"effect '{self.effect}' takes {', '.join(sorted(wanted))}")
        return self

    def amounts(self, base: FloatArray) -> list[tuple[int, float]]:
        """Return (index, amount) pairs that the term adds to the vector `base`."""
        return [
            pair
            for parameter in EFFECTS[self.effect].parameters
            for pair in parameter.amounts(parameter.theta(self.parameters[parameter.name]), base)
        ]


class FeatureTermEntry(FileModel):
    """What a feature adds to an equation: `coefficient` times the feature, SI."""

    equation: Literal["v_x", "v_y", "yaw_rate"]
    feature: str
    coefficient: float

    @model_validator(mode="after")
    def _known(self) -> FeatureTermEntry:
        if self.feature not in FEATURES:
            raise ValueError(f"feature '{self.feature}' is unknown")
        return self


class RoadEntry(FileModel):
    """
    Curves along a road: knots of uniform cubic B-splines, `spacing` m apart.

    The line's rows are distance, x, y (m) and heading (rad) in the frame of odometry's pose.
    """

    line: list[list[float]] = Field(min_length=1)
    spacing: float = Field(default=KNOT_SPACING_M, gt=0.0, le=1e3)
    curves: dict[Literal["grade", "bank", "friction"], list[float]] = Field(min_length=1)

    @model_validator(mode="after")
    def _complete(self) -> RoadEntry:
        if any(len(row) != 4 for row in self.line):
            raise ValueError("a row of the line is [distance, x, y, heading]")
        if len({len(knots) for knots in self.curves.values()}) != 1:
            raise ValueError("all curves need as many knots")
        if min(len(knots) for knots in self.curves.values()) < 4:
            raise ValueError("a curve needs four knots at least")
        return self

    def map(self) -> RoadProfile:
        """Return the road as it is computed with."""
        return RoadProfile(
            np.array(self.line),
            tuple(self.curves),
            np.array(list(self.curves.values())),
            self.spacing,
        )


class SimulatorExtras(FileModel):
    """What the simulator has beyond the model family's parameters."""

    road: RoadEntry | None = None
    correction: list[FeatureTermEntry] = Field(default_factory=list)


class SurrogateFile(FileModel):
    """The content of `simulation.yaml` and `corrected.yaml`."""

    kind: Literal["stand_in"]
    schema_version: Literal[1] = Field(default=1, alias="schema")
    parameters: dict[str, float]
    tolerances: dict[str, float] = Field(default_factory=dict)
    terms: list[EffectTermEntry] = Field(default_factory=list)
    correction: list[FeatureTermEntry] = Field(default_factory=list)
    own: SimulatorExtras = SimulatorExtras()

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
        """Return the parameter vector with the tolerances, terms apart."""
        p = default_parameters()
        for name, value in self.parameters.items():
            p[INDEX[name]] = value
        for name, share in self.tolerances.items():
            p[INDEX[name]] *= 1.0 + share
        return p

    def acting(self) -> FloatArray:
        """Return the same with the terms that are bound to no place."""
        base = self.vector()
        p: FloatArray = base.copy()
        for term in self.terms:
            if term.where.kind != "place":
                for i, size in term.amounts(base):
                    p[i] += size
        return p

    def coefficients(self) -> tuple[list[str], FloatArray]:
        """Return the corrections' features and what they add to the accelerations, (k, 3)."""
        every = [*self.own.correction, *self.correction]
        names = sorted({c.feature for c in every})
        table = np.zeros((len(names), 3))
        for c in every:
            table[names.index(c.feature), STATE_NAMES.index(c.equation)] += c.coefficient
        return names, table

    def road(self) -> RoadProfile | None:
        """Return the road that the simulator drives on, where it was learned."""
        return None if self.own.road is None else self.own.road.map()

    def simulator(self) -> SurrogateModel:
        """Return the stand-in of the simulator: nothing that was found in a recording."""
        pieces = tuple(
            FeatureTerm(c.equation, c.feature, c.coefficient, 0.0) for c in self.own.correction
        )
        return SurrogateModel(
            self.vector(),
            np.zeros(6),
            np.zeros((6, 100)),
            np.empty((0, SIZE)),
            self.road(),
            pieces,
        )


@dataclass(frozen=True)
class NamedSurrogate:
    """A model that was loaded, with its name for messages."""

    name: str
    content: SurrogateFile


def is_surrogate_file(path: Path) -> bool:
    """
    Whether a YAML file is a stand-in's and not a vehicle's.

    Raises `UsageError` for a file that cannot be read.
    """
    return path.is_file() and read(path, "model")[1].get("kind") == KIND


def load_surrogate(path: Path) -> NamedSurrogate:
    """
    Load a stand-in's YAML.

    Raises `UsageError`, one line naming the file and the key.
    """
    return NamedSurrogate(path.name, load(path, "stand-in", SurrogateFile))


def surrogate_yaml(
    vector: FloatArray,
    tolerances: dict[str, float] | None = None,
    terms: list[dict[str, Any]] | None = None,
    correction: list[dict[str, Any]] | None = None,
    simulator: SurrogateModel | None = None,
) -> str:
    """Return a stand-in's file as text, with what its `simulator` has of its own."""
    content: dict[str, Any] = {
        "kind": KIND,
        "schema": 1,
        "parameters": {name: _short(vector[i]) for i, name in enumerate(NAMES)},
    }
    if tolerances:
        content["tolerances"] = {name: _short(x) for name, x in tolerances.items()}
    if terms:
        content["terms"] = terms
    if correction:
        content["correction"] = correction
    own = {} if simulator is None else _own(simulator)
    if own:
        content["own"] = own
    text: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=96)
    return text


def _own(simulator: SurrogateModel) -> dict[str, Any]:
    own: dict[str, Any] = {}
    road = simulator.road
    if road is not None:
        own["road"] = {
            "spacing": road.spacing,
            "curves": {
                name: [_short(x) for x in knots]
                for name, knots in zip(road.entries, road.coefficients, strict=True)
            },
            "line": [[round(float(x), 4) for x in row] for row in road.line],
        }
    if simulator.feature_terms:
        own["correction"] = [
            {
                "equation": piece.equation,
                "feature": piece.feature,
                "coefficient": _short(piece.coefficient),
            }
            for piece in simulator.feature_terms
        ]
    return own


def _short(value: float) -> float:
    return float(np.format_float_positional(value, 8, unique=False, fractional=False))
