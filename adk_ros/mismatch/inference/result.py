# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the tool has found: all that the machine's answer and a person's report are made of."""

from __future__ import annotations

from dataclasses import dataclass, field

from adk_ros.mismatch.inference.experiment_design import Discriminability
from adk_ros.mismatch.inference.identifiability import CompetingEffect
from adk_ros.mismatch.inference.segments import SpatialProfile
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.numerics.arrays import FloatArray

NONE, EXPLAINED, UNKNOWN = "none", "explained", "unknown"


@dataclass(frozen=True)
class Interval:
    """A parameter's value with its 90 % interval."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class IdentifiedEffect:
    """
    One effect that the recording has and the simulation lacks.

    `gain` is what the loss would rise without it; `rivals` what was tried in its place;
    `stretches` (begin, end) in m along the lap of `lap_m` where it is bound to a place; one over
    the lap's end ends beyond `lap_m`, or begins below zero.
    """

    effect: Effect
    parameters: dict[str, Interval]
    confidence: float
    alternatives: list[str]
    kind: str
    time_intervals_s: list[list[float]]
    gain: float
    competitors: tuple[CompetingEffect, ...]
    segments: tuple[tuple[float, float], ...] = ()
    onset_s: float | None = None
    lap_m: float | None = None


@dataclass(frozen=True)
class UnexplainedResidual:
    """A remainder, by what it depends on: see `unknown`."""

    equations: list[str]
    share: float
    text: str
    expression: str
    terms: tuple[FeatureTerm, ...] = ()


@dataclass(frozen=True)
class ResidualSeries:
    """
    What a report draws: all in bins of 40 ms, SI.

    `time_s` (b,); `x`, `y` (b,) the pose; `signals` by name (b,): v_x, v_y, yaw_rate, a_x, a_y,
    torque, delta; `before`, `after` (6, b) residuals of `evidence.CHANNELS` of the stand-in and
    of the corrected model; `noise` (6,) of a bin; `distance` (b,) along the lap, if there is one;
    `without` by what was found the residuals (6, b) of the corrected model less that alone, where
    more than one thing was: effects by name, features of a remainder as `equation:feature`.
    """

    time_s: FloatArray
    x: FloatArray
    y: FloatArray
    signals: dict[str, FloatArray]
    before: FloatArray
    after: FloatArray
    noise: FloatArray
    distance: FloatArray | None = None
    without: dict[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True)
class MissingChannel:
    """What a recording is without, in a few words, and what follows from it, in a sentence."""

    what: str
    text: str


@dataclass(frozen=True)
class MismatchResult:
    """
    The whole answer.

    `before`, `after`: root mean square errors (v_x, v_y, yaw rate) `horizon_s` ahead, on the last
    part of the recording, which the parameters of `after` were not fitted to; NaN where nothing
    is claimed. `losses` the loss of the best hypothesis with 0, 1, 2, ... effects; `level` the
    number of residuals, which a perfect model's loss would be about. `simulation_yaml`,
    `corrected_yaml` the models' files.
    """

    verdict: str
    effects: list[IdentifiedEffect]
    unexplained: UnexplainedResidual | None
    horizon_s: float
    before: dict[str, float]
    after: dict[str, float]
    groups: list[list[str]]
    suggestion: str
    simulation_yaml: str
    corrected_yaml: str
    series: ResidualSeries
    surrogate_error: dict[str, float]
    losses: list[tuple[str, float]]
    expected_loss: float
    lap_m: float | None = None
    profiles: list[SpatialProfile] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    held_out_yaml: str = ""
    """The corrected model fitted to the part before the last, which `after` is of."""
    missing_channels: list[MissingChannel] = field(default_factory=list)
    not_judged: list[str] = field(default_factory=list)
    """Effects that were not looked for, since the recording's channels say nothing of them."""
    discriminability: list[Discriminability] = field(default_factory=list)
    """Of each pair that the drive cannot tell apart: the best manoeuvre of those simulated."""
