# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mismatch analysis: from a simulation and a recording to a result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from adk_ros.mismatch.deployment.corrected_model import corrected_yaml
from adk_ros.mismatch.deployment.held_out import HORIZONS_S, REPORTED_HORIZON, Evidence
from adk_ros.mismatch.deployment.predicted_signals import predicted_signals, unpredicted_signals
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.inference.candidates import rejected_candidates
from adk_ros.mismatch.inference.confirmation import confirmed
from adk_ros.mismatch.inference.decision import Decision, decide
from adk_ros.mismatch.inference.downweighted import (
    downweighted_residuals,
    note_on,
    with_episodes,
)
from adk_ros.mismatch.inference.experiment_design import (
    Discriminability,
    most_discriminating_manoeuvre,
)
from adk_ros.mismatch.inference.feature_effect import catalogue_effects
from adk_ros.mismatch.inference.final_estimate import refitted, with_confidence
from adk_ros.mismatch.inference.forward_selection import select_effects, selection_steps
from adk_ros.mismatch.inference.question import Questioned, answer
from adk_ros.mismatch.inference.result import IdentifiedEffect, MismatchResult
from adk_ros.mismatch.inference.steady_state import steady_state
from adk_ros.mismatch.leave_one_out import agreement_of
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import HELD_OUT_SHARE, SURROGATE_ERROR_AS_NOISE
from adk_ros.mismatch.recorded_data import RecordedData, usable_recordings
from adk_ros.mismatch.recording.checks import (
    check_recording,
    check_same_vehicle,
    check_torque_unit,
    check_vehicle,
)
from adk_ros.mismatch.recording.frozen_readings import without_frozen_readings
from adk_ros.mismatch.recording.joined import concatenated, in_sequence
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import CHANNELS, SensorLog
from adk_ros.mismatch.residual_series import residual_series
from adk_ros.mismatch.simulator import DEFAULT_WHEEL_RADIUS, default_vehicle, surrogate_of
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.mismatch.surrogate.residuals import ResidualProblem
from adk_ros.mismatch.validation import (
    coherent,
    exported,
    held_out_result,
    validate_on_held_out,
)
from adk_ros.numerics.arrays import FloatArray

Progress = Callable[[float, float, str], None]
_TOTAL = 10.0
_IDENTIFIED, _SELECTED, _DECIDED = 2.0, 7.0, 9.0
"""Progress, of `_TOTAL`, after the stages of an analysis."""


def identify_mismatch(
    simulation: SensorLog | SurrogateModel,
    recording: SensorLog | Sequence[SensorLog],
    nominal: NominalVehicle | None = None,
    progress: Progress | None = None,
    held_out: Sequence[SensorLog] = (),
    ask: Sequence[str] = (),
) -> MismatchResult:
    """
    Identify the effects in `recording` that `simulation` lacks.

    Several recordings of one car, in their order in time, are analysed jointly: one set of effects
    and sizes, places per route, and a comparison of the recordings. Effects, places, onsets and
    sizes are selected on the part before the last quarter of each recording, which is
    used only to measure the improvement; with `held_out` recordings, on all of `recording`. The
    reported sizes are then fitted to all of it. The simulation may be a surrogate that is already
    identified. Without an IMU or a torque command, fewer effects are examined (see
    `inference.observability`). Without a `nominal` vehicle, mass and lengths are identified from
    the simulation as far as possible. `progress` is called with (done, total, stage).
    `ask`: effects of the catalogue, to be answered why they are claimed or not.

    Raises `DataError` for recordings that do not allow an analysis.
    """
    report = progress or (lambda done, total, text: None)
    logs = [recording] if isinstance(recording, SensorLog) else list(recording)
    has_imu = all(log.imu_s.size > 0 for log in logs)
    logs = usable_recordings(logs)
    dropouts: list[str] = []
    for i, log in enumerate(logs):
        logs[i], lost = without_frozen_readings(log)
        dropouts += [f"{log.name}: {line}" for line in lost] if len(logs) > 1 else lost
    noise = [log.noise() for log in logs]
    if isinstance(simulation, SurrogateModel):
        surrogate, notes = simulation, _notes_on_known(simulation)
        noise = [np.maximum(x, _error_as_noise(simulation)) for x in noise]
    else:
        check_recording(simulation)
        for log in logs:
            check_same_vehicle(simulation, log)
        if nominal is not None:
            check_vehicle(nominal, simulation)
        vehicle = nominal or default_vehicle(simulation)
        for log in logs:
            check_torque_unit(log, vehicle.mass, vehicle.wheel_radius)
        report(0.0, _TOTAL, "identifying the simulator")
        surrogate, notes = surrogate_of(
            simulation,
            logs[0] if len(logs) == 1 else concatenated(in_sequence(logs)),
            nominal,
            lambda done, text: report(_IDENTIFIED * done, _TOTAL, text),
        )
        notes += _notes_on_default_vehicle(nominal)
    share = 0.0 if held_out else HELD_OUT_SHARE
    data = RecordedData.of(surrogate, logs, noise, has_imu, share)
    lap = data.lap
    single_lap = lap if lap is not None and len(lap.routes) == 1 else None
    lap_m = None if single_lap is None else single_lap.length
    training = data.training()
    path = select_effects(
        training,
        lap,
        lambda done, total, text: report(
            _IDENTIFIED + (_SELECTED - _IDENTIFIED) * done / total, _TOTAL, text
        ),
    )
    report(_SELECTED, _TOTAL, "comparing competing effects")
    decision = data.observable.withhold_if_underexplained(decide(training, path), training, path)
    if data.recordings:
        decision = data.with_onsets_at_starts(decision)
    report(_DECIDED, _TOTAL, "predicting held-out data")
    likelihood = data.whole()
    if not held_out:
        decision = confirmed(decision, training, likelihood)
    evidence = [Evidence(log) for log in held_out] or data.held_out(decision.hypothesis)
    validation = validate_on_held_out(
        surrogate, decision.hypothesis, lap, evidence, data.not_predicted()
    )
    decision = coherent(decision, validation)
    about = Questioned(training, path, decision, lap, surrogate.parameters)
    asked = [answer(name, about) for name in ask]
    decision = with_confidence(refitted(decision, likelihood), validation.error_ratio)
    hidden = downweighted_residuals(likelihood, decision.hypothesis, surrogate, single_lap)
    decision = with_episodes(decision, hidden)
    correction = exported(decision.hypothesis, validation.export)
    discriminability = _discriminability(surrogate, decision, data.problem)
    tied = [e for e in decision.effects if e.alternatives]
    suggestions = [_suggested_manoeuvre(e, discriminability) for e in tied]
    report(_TOTAL, _TOTAL, "done")
    return MismatchResult(
        effects=[replace(e, lap_m=lap_m, recordings=data.recordings) for e in decision.effects],
        verdict=decision.verdict,
        unexplained=decision.unexplained,
        horizon_s=HORIZONS_S[REPORTED_HORIZON],
        before=validation.errors.at(validation.errors.before),
        after=validation.errors.at(validation.errors.after),
        groups=[[e.effect.name, *e.alternatives] for e in tied],
        suggestion="; ".join(dict.fromkeys(s for s in suggestions if s)),
        simulation_yaml=simulation_yaml(surrogate),
        corrected_yaml=(
            simulation_yaml(surrogate)
            if correction is None
            else corrected_yaml(surrogate, correction, lap)
        ),
        series=residual_series(likelihood, decision.hypothesis, lap),
        surrogate_error=dict(zip(CHANNELS, (float(x) for x in surrogate.error), strict=True)),
        steps=selection_steps(path),
        expected_loss=path.expected_loss,
        surrogate_error_dof=path.surrogate_error_dof,
        lap_m=lap_m,
        profiles=path.profiles if lap_m else [],
        notes=[*notes, *dropouts, *note_on(hidden), *_notes_on_lap(lap)],
        held_out_yaml=validation.held_out_yaml,
        missing_channels=data.observable.missing_channels(),
        not_judged=sorted(data.observable.unobservable & set(EFFECTS)),
        discriminability=discriminability,
        held_out=held_out_result(validation, evidence),
        candidates=rejected_candidates(training, path, decision),
        direct=data.direct_comparisons(simulation),
        asked=asked,
        signals=predicted_signals(
            (simulation_yaml(surrogate), validation.held_out_yaml),
            evidence[0],
            held_out_result(validation, evidence[:1]).source,
            unpredicted_signals(data.observable.torque, has_imu),
        ),
        downweighted=hidden,
        steady_state=steady_state(likelihood, decision.hypothesis, data.observable.torque),
        agreement=agreement_of(data, decision, likelihood, path),
    )


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
