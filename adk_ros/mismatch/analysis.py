# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mismatch analysis: from a simulation and a recording to a result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import yaml  # type: ignore[import-untyped, unused-ignore]

from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.corrected_model import corrected_yaml
from adk_ros.mismatch.deployment.open_loop import horizon_rmse
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.inference.decision import Decision, decide
from adk_ros.mismatch.inference.experiment_design import (
    Discriminability,
    most_discriminating_manoeuvre,
)
from adk_ros.mismatch.inference.feature_effect import catalogue_effects
from adk_ros.mismatch.inference.fit_budget import HELD_OUT
from adk_ros.mismatch.inference.forward_selection import select_effects
from adk_ros.mismatch.inference.likelihood import Hypothesis, Likelihood
from adk_ros.mismatch.inference.observability import (
    ObservableEffects,
    longest_moving_segment,
    observable_effects,
    with_pseudo_imu,
)
from adk_ros.mismatch.inference.result import (
    NONE,
    IdentifiedEffect,
    MismatchResult,
    ResidualSeries,
)
from adk_ros.mismatch.inference.surrogate_extension import augment_surrogate
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import (
    HELD_OUT_SHARE,
    MIN_ROAD_COVERAGE,
    SURROGATE_ERROR_AS_NOISE,
)
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.checks import (
    check_recording,
    check_same_vehicle,
    check_vehicle,
    effective_mass,
)
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import CHANNELS, SensorLog
from adk_ros.mismatch.surrogate.feature_terms import feature_signals
from adk_ros.mismatch.surrogate.identification import SurrogateModel, identify_surrogate
from adk_ros.mismatch.surrogate.lap import Lap, find_lap
from adk_ros.mismatch.surrogate.residuals import BIN_S, ResidualProblem, prepare_residual_problem
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES

HORIZON_S = 1.0
"""Horizon of the reported errors, s."""
DEFAULT_WHEEL_RADIUS = 0.325
"""m, where no vehicle is given: torque over mass and wheel radius are not identifiable apart."""
_DEFAULT_MASS = 1600.0
_MASS_RANGE = (200.0, 4e4)
"""kg: default and range of the mass of a vehicle that is not given."""
_INERTIA_PER_MASS, _CG_TO_FRONT, _CG_TO_REAR, _TRACK_WIDTH = 1.75, 1.3, 1.4, 1.6
"""m² and m, of a mid-size car."""

Progress = Callable[[float, float, str], None]
_TOTAL = 10.0
_IDENTIFIED, _SELECTED, _DECIDED = 2.0, 7.0, 9.0
"""Progress, of `_TOTAL`, after the stages of an analysis."""


def identify_mismatch(
    simulation: SensorLog | SurrogateModel,
    recording: SensorLog,
    nominal: NominalVehicle | None = None,
    progress: Progress | None = None,
) -> MismatchResult:
    """
    Identify the effects in `recording` that `simulation` lacks.

    The simulation may be a surrogate that is already identified. Without an IMU or a torque
    command, fewer effects are examined (see `inference.observability`). Without a `nominal`
    vehicle, mass and lengths are identified from the simulation as far as possible. `progress` is
    called with (done, total, stage).

    Raises `DataError` for recordings that do not allow an analysis.
    """
    report = progress or (lambda done, total, text: None)
    has_imu = recording.imu_s.size > 0
    recording = recording if has_imu else with_pseudo_imu(longest_moving_segment(recording))
    check_recording(recording)
    if isinstance(simulation, SurrogateModel):
        surrogate, notes = simulation, _notes_on_known(simulation)
        noise = np.maximum(recording.noise(), _error_as_noise(simulation))
    else:
        check_recording(simulation)
        check_same_vehicle(simulation, recording)
        if nominal is not None:
            check_vehicle(nominal, simulation)
        report(0.0, _TOTAL, "identifying the simulator")
        surrogate, notes = surrogate_of(simulation, recording, nominal, report)
        notes += _notes_on_default_vehicle(nominal)
        noise = recording.noise()
    analysis = _Analysis.of(surrogate, prepare_residual_problem(recording, noise), has_imu)
    lap, likelihood = analysis.lap, analysis.likelihood()
    path = select_effects(
        likelihood,
        lap,
        lambda done, total, text: report(
            _IDENTIFIED + (_SELECTED - _IDENTIFIED) * done / total, _TOTAL, text
        ),
    )
    report(_SELECTED, _TOTAL, "comparing competing effects")
    decision = analysis.observable.withhold_if_underexplained(
        decide(likelihood, path), likelihood, path
    )
    report(_DECIDED, _TOTAL, "predicting held-out data")
    improvement = analysis.improvement(decision.hypothesis)
    discriminability = _discriminability(surrogate, decision, analysis.problem)
    tied = [e for e in decision.effects if e.alternatives]
    suggestions = [_suggested_manoeuvre(e, discriminability) for e in tied]
    report(_TOTAL, _TOTAL, "done")
    return MismatchResult(
        effects=[replace(e, lap_m=None if lap is None else lap.length) for e in decision.effects],
        verdict=decision.verdict,
        unexplained=decision.unexplained,
        horizon_s=HORIZON_S,
        before=improvement.before,
        after=improvement.after,
        groups=[[e.effect.name, *e.alternatives] for e in tied],
        suggestion="; ".join(dict.fromkeys(s for s in suggestions if s)),
        simulation_yaml=simulation_yaml(surrogate),
        corrected_yaml=corrected_yaml(surrogate, decision.hypothesis, lap),
        series=_series(likelihood, decision.hypothesis, lap),
        surrogate_error=dict(zip(CHANNELS, (float(x) for x in surrogate.error), strict=True)),
        losses=[("+".join(level[0].names) or NONE, level[0].loss) for level in path.levels],
        expected_loss=path.expected_loss,
        lap_m=None if lap is None else lap.length,
        profiles=path.profiles,
        notes=notes + _notes_on_lap(lap),
        held_out_yaml=improvement.held_out_yaml,
        missing_channels=analysis.observable.missing_channels(),
        not_judged=sorted(analysis.observable.unobservable & set(EFFECTS)),
        discriminability=discriminability,
    )


def surrogate_of(
    simulation: SensorLog,
    recording: SensorLog,
    nominal: NominalVehicle | None,
    report: Progress,
) -> tuple[SurrogateModel, list[str]]:
    """Identify the simulator's surrogate, extended where it underfits; return it with notes."""
    problem, body_known = prepare_residual_problem(simulation), nominal is not None
    start = (nominal or default_vehicle(simulation)).parameters()
    plain = identify_surrogate(
        problem,
        start,
        lambda done, total: report(done / total, _TOTAL, "identifying the simulator"),
        body_known,
    )
    extended = augment_surrogate(
        problem,
        plain,
        start,
        body_known,
        lambda done, total: report(1.0 + done / total, _TOTAL, "extending the surrogate"),
    )
    road = extended.road
    if road is not None:
        coverage = road.covered_share(prepare_residual_problem(recording))
        if coverage < MIN_ROAD_COVERAGE:
            return plain, [
                "the recording is on another road than the simulation, or their pose frames "
                "differ: the identified road profile is ignored"
            ]
    if not extended.augmentation_notes:
        return plain, []
    return extended, [
        "the surrogate needed more than tyres and body to reproduce the simulation; it also has: "
        f"{'; '.join(extended.augmentation_notes)}"
    ]


@dataclass(frozen=True)
class _Improvement:
    """RMSE ahead before and after on the held-out part, and the corrected model that was used."""

    before: dict[str, float]
    after: dict[str, float]
    held_out_yaml: str


@dataclass(frozen=True)
class _Analysis:
    """A surrogate and a recording's residual problem, with what the channels show, and the lap."""

    surrogate: SurrogateModel
    problem: ResidualProblem
    observable: ObservableEffects
    lap: Lap | None

    @classmethod
    def of(cls, surrogate: SurrogateModel, problem: ResidualProblem, has_imu: bool) -> _Analysis:
        mass, radius = (float(surrogate.parameters[INDEX[k]]) for k in ("mass", "wheel_radius"))
        observable = observable_effects(problem.log, mass, radius, has_imu)
        return cls(surrogate, problem, observable, find_lap(problem))

    def likelihood(self, until_s: float = np.inf) -> Likelihood:
        """Return the likelihood of the recording, or of its part before `until_s`."""
        filtered = self.observable.with_yaw_filter(self.surrogate)
        return self.observable.masked(Likelihood.of(self.problem, filtered, until_s))

    def improvement(self, h: Hypothesis) -> _Improvement:
        """Fit a hypothesis to the first part of the recording and predict the last part."""
        log = self.problem.log
        from_s = log.duration_s * (1.0 - HELD_OUT_SHARE)
        fitted = self.likelihood(from_s).fit(h.effects, nuisances=h.nuisances, budget=HELD_OUT)
        held_out_yaml = corrected_yaml(self.surrogate, fitted, self.lap)
        before, after = (
            horizon_rmse(_parsed(text), log, HORIZON_S, from_s)
            for text in (simulation_yaml(self.surrogate), held_out_yaml)
        )
        if not self.observable.torque:
            before[0] = after[0] = np.nan
        return _Improvement(_by_state(before), _by_state(after), held_out_yaml)


def _error_as_noise(surrogate: SurrogateModel) -> FloatArray:
    """
    Return the part (6,) of a known surrogate's error that counts as sensor noise.

    Not for a surrogate from a file, which was identified on a noise-free simulation.
    """
    if surrogate.autocovariance is not None:
        return np.zeros(len(CHANNELS))
    return np.asarray(SURROGATE_ERROR_AS_NOISE * surrogate.error)


def _discriminability(
    surrogate: SurrogateModel, decision: Decision, problem: ResidualProblem
) -> list[Discriminability]:
    """Return the best manoeuvre for each pair of indistinguishable effects."""
    effects = catalogue_effects(decision.hypothesis.effects)
    index = {a.effect.name: i for i, a in enumerate(effects)}
    return [
        most_discriminating_manoeuvre(
            surrogate.parameters,
            effects,
            index[identified.effect.name],
            competitor.fitted,
            problem.bin_noise,
        )
        for identified in decision.effects
        if identified.effect.name in index
        for competitor in identified.competitors
        if competitor.alternative
    ]


def _suggested_manoeuvre(
    identified: IdentifiedEffect, discriminability: list[Discriminability]
) -> str:
    """Return the manoeuvres that distinguish an effect: simulated, or from the catalogue."""
    simulated = [
        d.manoeuvre for d in discriminability if d.of == identified.effect.name and d.distinguishes
    ]
    listed = [EFFECTS[name].manoeuvre for name in identified.alternatives if name in EFFECTS]
    return "; ".join(dict.fromkeys(simulated or listed))


def default_vehicle(simulation: SensorLog) -> NominalVehicle:
    """Return a mid-size car of the mass that the simulation's torque response implies."""
    identified = effective_mass(simulation, DEFAULT_WHEEL_RADIUS) or _DEFAULT_MASS
    mass = min(max(identified, _MASS_RANGE[0]), _MASS_RANGE[1])
    return NominalVehicle(
        mass=mass,
        yaw_inertia=_INERTIA_PER_MASS * mass,
        cg_to_front_axle=_CG_TO_FRONT,
        cg_to_rear_axle=_CG_TO_REAR,
        track_width=_TRACK_WIDTH,
        wheel_radius=DEFAULT_WHEEL_RADIUS,
    )


def _notes_on_known(surrogate: SurrogateModel) -> list[str]:
    if np.any(surrogate.error > 0.0):
        return []
    return [
        "the surrogate's file does not hold its error on the simulation: effects may be reported "
        "with too much confidence; write the file again from the simulation's bag"
    ]


def _notes_on_default_vehicle(nominal: NominalVehicle | None) -> list[str]:
    if nominal is not None:
        return []
    return [
        "no --vehicle: masses and lengths are identified from the simulation, for wheels of "
        f"{DEFAULT_WHEEL_RADIUS:g} m radius"
    ]


def _notes_on_lap(lap: Lap | None) -> list[str]:
    if lap is not None:
        return []
    return [
        "no part of the route is driven twice, so local effects (grade, bank, friction patches) "
        "cannot be identified"
    ]


def _parsed(text: str) -> SurrogateFile:
    return validate("model", yaml.safe_load(text), SurrogateFile)


def _by_state(values: FloatArray) -> dict[str, float]:
    return dict(zip(STATE_NAMES, (float(x) for x in values), strict=True))


def _binned(problem: ResidualProblem, values: FloatArray) -> FloatArray:
    """Return the mean of a signal (n,) in each bin (b,)."""
    since_start = (problem.middle_s - problem.start_s) / BIN_S
    row = np.minimum((since_start + 1e-6).astype(np.int64), problem.bins - 1)
    count = np.maximum(np.bincount(row, minlength=problem.bins), 1)
    return np.asarray(np.bincount(row, values, problem.bins) / count)


def _series(likelihood: Likelihood, h: Hypothesis, lap: Lap | None) -> ResidualSeries:
    problem = likelihood.problem
    counted = likelihood.weights > 0.0
    p, terms = likelihood.simulation_inputs(h.nuisances, h.effects)
    out = problem.run(p, terms)
    signals = {name: _binned(problem, x) for name, x in feature_signals(problem, out).items()}
    without = {}
    for i, active in enumerate(h.effects if len(h.effects) > 1 else ()):
        others = [*h.effects[:i], *h.effects[i + 1 :]]
        inputs = likelihood.simulation_inputs(h.nuisances, others)
        without[active.effect.name] = counted * problem.residuals(*inputs)
    return ResidualSeries(
        time_s=problem.bin_s,
        x=_binned(problem, problem.pose[:, 0]),
        y=_binned(problem, problem.pose[:, 1]),
        signals=signals,
        before=counted * problem.residuals(likelihood.parameters, likelihood.fixed_terms),
        after=counted * problem.residuals(p, terms, out=out),
        noise=problem.bin_noise,
        distance=None if lap is None else _binned(problem, lap.unwrapped) % lap.length,
        without=without,
    )
