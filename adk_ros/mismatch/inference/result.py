# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Result types of a mismatch analysis; `mismatch.json` and the report are made of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from adk_ros.calibration.scope import Scope
from adk_ros.mismatch.inference.asked_effect import AskedEffect
from adk_ros.mismatch.inference.confidence import Evidence
from adk_ros.mismatch.inference.downweighted_episodes import Downweighted
from adk_ros.mismatch.inference.experiment_design import Discriminability
from adk_ros.mismatch.inference.identifiability import CompetingEffect
from adk_ros.mismatch.inference.interval import Interval as Interval
from adk_ros.mismatch.inference.segments import SpatialProfile
from adk_ros.mismatch.inference.signal_fit import PredictedSignals
from adk_ros.mismatch.inference.steady_state import SteadyState
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.library.sensitivity import Decisions
from adk_ros.mismatch.recording.direct_comparison import DirectComparison
from adk_ros.mismatch.recording.measured_road import MeasuredRoad
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.decode import SensorConfig

NONE, EXPLAINED, UNKNOWN = "none", "explained", "unknown"
FULL, HALF_TOLERANCES, WITHOUT_TOLERANCES, WITHOUT_FEATURES, NOT_EXPORTED = (
    "full",
    "half of the tolerances",
    "without tolerances",
    "without feature terms",
    "none",
)
"""What an exported correction consists of, in the order in which it is tried."""
NOT_SUPPORTED = (
    "the errors are explained without it, and data that it was not fitted to do not support it"
)
"""Why an effect is not claimed where nothing is missing."""
NOT_CHECKED = (
    "no prediction error could be measured: in the held-out data the car does not move, or only "
    "in ways that the simulation does not reach"
)
"""Why a result is unknown that no prediction checks (`UnexplainedResidual.text`)."""

NOT_JUDGED = "the recorded commands do not say what moves the car"
"""Why a result is unknown that compares nothing (`UnexplainedResidual.text`)."""


@dataclass(frozen=True)
class RecordingSpan:
    """
    One of several recordings on their common axis of time, which follow each other.

    `begin_s`: its zero of time; `route`: index of its route, None if it drives no known lap;
    `lap_m`: length of that route's lap.
    """

    name: str
    begin_s: float
    end_s: float
    route: int | None = None
    lap_m: float | None = None


@dataclass(frozen=True)
class IdentifiedEffect:
    """
    An effect in the recording that the simulation lacks.

    `gain`: increase in loss without it. `competitors`: effects fitted in its place, closest first.
    `segments`: (begin, end) in m along the lap of `lap_m`, for an effect at a place; a segment
    across the start of the lap ends beyond `lap_m` or begins below zero. `confidence`: posterior
    probability of the effect, or of those that cannot be distinguished from it; `posterior`: that
    of each alternative.
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
    evidence: Evidence | None = None
    posterior: dict[str, float] = field(default_factory=dict)
    recordings: tuple[RecordingSpan, ...] = ()
    """The recordings of a joint analysis: onsets and segments refer to them."""


@dataclass(frozen=True)
class UnexplainedResidual:
    """
    What unmodelled dynamics depend on.

    `share`: of a formula, of the excess loss before any effect; of episodes alone, of the loss
    above that of noise; of a held-out error, the part of its square above the expected one that
    is left; 1 where a claim was withdrawn, or where noise may explain the recording without the
    formula.
    `meaning`: the terms as masses, forces and shares, where they have such a meaning.
    """

    equations: list[str]
    share: float
    text: str
    expression: str
    terms: tuple[FeatureTerm, ...] = ()
    meaning: str = ""


@dataclass(frozen=True)
class ResidualSeries:
    """
    Time series for the report, in bins of 40 ms, SI.

    `time_s` (b,); `x`, `y` (b,) the pose; `signals` by name (b,): v_x, v_y, yaw_rate, a_x, a_y,
    torque, delta; `before`, `after` (6, b) residuals of the surrogate and of the corrected model,
    by channel; `noise` (6,) of a bin; `distance` (b,) along the lap, if there is one; `without`
    the corrected model's residuals (6, b) less one effect or feature, where there are several:
    effects by name, features as `equation:feature`.
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
class HeldOutResult:
    """
    Open-loop errors on the held-out data, which can withdraw claims and choose the export.

    `source`: which data. RMSE by state, one value per horizon of `horizons_s`, SI: of the
    simulation (`before`), the exported correction (`after`), a constant state (`persistence`), and
    what noise, build tolerances and the surrogate's own error explain (`expected`). `explained`:
    whether no error is larger than the model can explain; `ratio`: error over the largest that it
    can explain. `export`: which correction is exported; `raised`: states whose error a larger one
    raised; `rejected`: the RMSE with the full correction where none is exported, if there was one.
    `tolerances_fitted`: the ratios are those of the simulation with the build tolerances
    that the training part shows, and `expected` is without tolerances.
    """

    source: str
    horizons_s: tuple[float, ...]
    before: dict[str, list[float]]
    after: dict[str, list[float]]
    persistence: dict[str, list[float]]
    expected: dict[str, list[float]]
    ratio: dict[str, list[float]]
    starts: int
    explained: bool
    export: str
    raised: tuple[str, ...] = ()
    tolerances_fitted: bool = False
    rejected: dict[str, list[float]] | None = None


@dataclass(frozen=True)
class RejectedCandidate:
    """An effect that was fitted and is not claimed; `share` of the excess loss it removes."""

    name: str
    parameters: dict[str, Interval]
    share: float
    kind: str
    reason: str


@dataclass(frozen=True)
class SelectionStep:
    """
    The best hypothesis with some number of effects, and its loss.

    `gain`: penalised gain over the best one with an effect less; `required`: what was required.
    """

    names: tuple[str, ...]
    loss: float
    gain: float = 0.0
    required: float = 0.0


@dataclass(frozen=True)
class ParameterAgreement:
    """
    One parameter of an effect, from all recordings (`joint`) and from each alone.

    `each`: None where the effect does not act. Cochran's Q, its p-value and I^2, if at least two
    recordings show the effect; `odd`: the recording without which the others agree on `others`.
    """

    effect: str
    parameter: str
    joint: Interval
    each: tuple[Interval | None, ...]
    q: float = math.nan
    p_value: float = math.nan
    i_squared: float = math.nan
    disagree: bool = False
    odd: int | None = None
    others: float = math.nan
    claimed: bool = True
    """False: the best single effect, which is no part of the result; listed if it disagrees."""


@dataclass(frozen=True)
class LeftOutErrors:
    """RMSE by state `horizon_s` ahead on a recording, with sizes fitted to the others only."""

    before: dict[str, float]
    after: dict[str, float]


@dataclass(frozen=True)
class Agreement:
    """Several recordings of one car, compared; one of `left_out` per recording."""

    recordings: tuple[RecordingSpan, ...]
    parameters: tuple[ParameterAgreement, ...]
    left_out: tuple[LeftOutErrors, ...]


@dataclass(frozen=True)
class MissingChannel:
    """A channel that the recording lacks, and the consequence in one sentence."""

    what: str
    text: str


@dataclass(frozen=True)
class MismatchResult:
    """
    The result of a mismatch analysis.

    `before`, `after`: RMSE of v_x, v_y and yaw rate `horizon_s` ahead, on the last part of the
    recording, which the parameters of `after` were not fitted to; NaN where a channel allows no
    statement. `steps`: the best hypothesis of each size, without effects first;
    `expected_loss` that of a perfect model. `simulation_yaml`, `corrected_yaml`: the models'
    files.
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
    steps: list[SelectionStep]
    expected_loss: float
    surrogate_error_dof: float = 0.0
    """Number of residuals that the surrogate's own error accounts for."""
    surrogate_variance_share: float = 0.0
    """Share of the residuals' variance that is the surrogate's own error; widens intervals."""
    lap_m: float | None = None
    profiles: list[SpatialProfile] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    held_out_yaml: str = ""
    """The corrected model fitted to the part before the held-out one; `after` is of it."""
    missing_channels: list[MissingChannel] = field(default_factory=list)
    not_judged: list[str] = field(default_factory=list)
    """Effects that the recorded channels do not show, and that were not considered."""
    discriminability: list[Discriminability] = field(default_factory=list)
    """The most discriminating manoeuvre for each pair of indistinguishable effects."""
    held_out: HeldOutResult | None = None
    """Errors on held-out data by horizon; None if they were not measured."""
    candidates: list[RejectedCandidate] = field(default_factory=list)
    """Effects that were fitted and are not claimed, largest gain first."""
    direct: list[DirectComparison] = field(default_factory=list)
    """Quantities of both recordings without a surrogate model; empty without two bags."""
    asked: list[AskedEffect] = field(default_factory=list)
    """Answers to the questions why an effect is claimed or not."""
    signals: PredictedSignals | None = None
    """Held-out signals in physical units, predicted 1 s ahead; None where none fits in."""
    steady_state: SteadyState | None = None
    """Understeer and resistance, measured and simulated on the same inputs."""
    downweighted: Downweighted | None = None
    """Episodes of residuals beyond what noise causes; None if there are none."""
    agreement: Agreement | None = None
    """The comparison of several recordings; None for one."""
    set_aside: list[str] = field(default_factory=list)
    """Effects in the correction that are not claimed, since they are less probable than not."""
    scope: list[Scope] = field(default_factory=list)
    """What the channels allow to predict, judge and calibrate, and why not more."""
    sensors: SensorConfig = field(default_factory=SensorConfig)
    """How the recordings were read; parameters that a calibration needs are relative to it."""
    road: MeasuredRoad | None = None
    """Slopes of the recordings' road by their attitude; None where it is not used."""
    decisions: dict[str, Decisions] = field(default_factory=dict)
    """By criterion, the decisions that half or double of its value would change."""
