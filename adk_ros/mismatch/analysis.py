# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The whole way from two recordings to findings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.open_loop import horizon_rmse
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile, surrogate_yaml
from adk_ros.mismatch.inference.decision import Decision, decide
from adk_ros.mismatch.inference.experiment_design import (
    Discriminability,
    most_discriminating_manoeuvre,
)
from adk_ros.mismatch.inference.forward_selection import select_effects
from adk_ros.mismatch.inference.likelihood import (
    N_FIXED_NUISANCES,
    TOLERANCE_PARAMETERS,
    ActiveEffect,
    Hypothesis,
    Likelihood,
)
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
from adk_ros.mismatch.inference.unmodelled import MARK, UnmodelledDynamics
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import PLACE
from adk_ros.mismatch.library.surrogate_parameters import HIGH, INDEX, LOW
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
DEFAULT_WHEEL_RADIUS = 0.325
"""m, where no vehicle is given: mass and radius act as one on torque."""
SURROGATE_ERROR_AS_NOISE = 0.5
"""Share of the error of a stand-in that was calibrated elsewhere, to be taken for noise."""
MIN_ROAD_COVERAGE = 0.8
"""Share of a recording that must lie on the simulator's road for its curves to be of use."""
HELD_OUT_SHARE = 0.25
"""Last share of the recording, on which the improvement is measured."""

Progress = Callable[[float, float, str], None]


def identify_mismatch(
    simulation: SensorLog | SurrogateModel,
    recording: SensorLog,
    nominal: NominalVehicle | None = None,
    progress: Progress | None = None,
) -> MismatchResult:
    """
    Find out what `recording` has that `simulation` leaves out.

    The simulation may be a stand-in that is known already. Of a recording without an IMU, or
    without torques, less is asked: see `scope`. Without a `nominal` vehicle one is assumed, and
    its masses and lengths are identified as far as the simulation shows them. `progress` is
    called with (done, total, what). Raises
    `DataError` for recordings that no finding can be drawn from.
    """
    tell = progress or (lambda done, total, text: None)
    has_imu = recording.imu_s.size > 0
    recording = recording if has_imu else with_pseudo_imu(longest_moving_segment(recording))
    check_recording(recording)
    notes: list[str] = []
    if isinstance(simulation, SurrogateModel):
        stand_in = simulation
    else:
        check_recording(simulation)
        check_same_vehicle(simulation, recording)
        if nominal is not None:
            check_vehicle(nominal, simulation)
        tell(0.0, 10.0, "identifying the simulator")
        stand_in, notes = surrogate_of(simulation, recording, nominal, tell)
    mass, radius = (float(stand_in.parameters[INDEX[k]]) for k in ("mass", "wheel_radius"))
    scope = observable_effects(recording, mass, radius, has_imu)
    known = isinstance(simulation, SurrogateModel)
    # Much of a calibrated model's own error would be cut off as outliers of a quiet sensor.
    own = SURROGATE_ERROR_AS_NOISE * stand_in.error if known else np.zeros(6)
    course = prepare_residual_problem(recording, np.maximum(recording.noise(), own))
    lap = find_lap(course)
    likelihood = scope.masked(Likelihood.of(course, scope.with_yaw_filter(stand_in)))
    found = select_effects(
        likelihood, lap, lambda done, total, text: tell(2.0 + 5.0 * done / total, 10.0, text)
    )
    tell(7.0, 10.0, "judging rivals")
    verdict = scope.withhold_if_underexplained(decide(likelihood, found), likelihood, found)
    tell(9.0, 10.0, "driving on held-out data")
    corrected = _corrected_yaml(stand_in, verdict, verdict.hypothesis, lap)
    before, after, early = _improvement(likelihood, stand_in, verdict, lap, scope)
    groups = [[e.effect.name, *e.alternatives] for e in verdict.effects if e.alternatives]
    separations = _discriminability(stand_in, verdict, course)
    suggestions = [_suggested_manoeuvre(e, separations) for e in verdict.effects if e.alternatives]
    tell(10.0, 10.0, "done")
    effects = [replace(e, lap_m=None if lap is None else lap.length) for e in verdict.effects]
    return MismatchResult(
        effects=effects,
        verdict=verdict.verdict,
        unexplained=verdict.unexplained,
        horizon_s=HORIZON_S,
        before=before,
        after=after,
        groups=groups,
        suggestion="; ".join(dict.fromkeys(s for s in suggestions if s)),
        simulation_yaml=surrogate_yaml(stand_in.parameters, simulator=stand_in),
        corrected_yaml=corrected,
        series=_series(course, likelihood, verdict.hypothesis, lap),
        surrogate_error=dict(zip(CHANNELS, (float(x) for x in stand_in.error), strict=True)),
        losses=[("+".join(level[0].names) or NONE, level[0].cost) for level in found.levels],
        expected_loss=found.expected_loss,
        lap_m=None if lap is None else lap.length,
        profiles=found.profiles,
        notes=notes + _notes(nominal is None and not known, lap),
        held_out_yaml=early,
        missing_channels=scope.missing_channels(),
        not_judged=sorted(scope.unobservable & set(EFFECTS)),
        discriminability=separations,
    )


def surrogate_of(
    simulation: SensorLog, recording: SensorLog, nominal: NominalVehicle | None, tell: Progress
) -> tuple[SurrogateModel, list[str]]:
    """Return the simulator's stand-in, with what acts where the recording drives, and notes."""
    course, known = prepare_residual_problem(simulation), nominal is not None
    begun = (nominal or default_vehicle(simulation)).parameters()
    plain = identify_surrogate(
        course,
        begun,
        lambda done, total: tell(done / total, 10.0, "identifying the simulator"),
        known,
    )
    whole = augment_surrogate(
        course,
        plain,
        begun,
        known,
        lambda done, total: tell(1.0 + done / total, 10.0, "learning the rest of the simulator"),
    )
    if (
        whole.road is not None
        and whole.road.covered_share(prepare_residual_problem(recording)) < MIN_ROAD_COVERAGE
    ):
        return plain, [
            "the simulated road was learned, but the recording drives another, or its poses have "
            "another origin: nothing of it is used"
        ]
    if not whole.augmentation_notes:
        return plain, []
    return whole, [
        "tyres and body alone do not meet the simulation; what was learned of it besides: "
        f"{'; '.join(whole.augmentation_notes)}"
    ]


def _discriminability(
    stand_in: SurrogateModel, verdict: Decision, course: ResidualProblem
) -> list[Discriminability]:
    """Return for each pair that the drive cannot tell apart what would, if anything."""
    actives = [a for a in verdict.hypothesis.actives if not a.effect.name.startswith(MARK)]
    place = {a.effect.name: i for i, a in enumerate(actives)}
    return [
        most_discriminating_manoeuvre(
            stand_in.parameters, actives, place[found.effect.name], rival.fitted, course.bin_noise
        )
        for found in verdict.effects
        if found.effect.name in place
        for rival in found.competitors
        if rival.alternative
    ]


def _suggested_manoeuvre(found: IdentifiedEffect, separations: list[Discriminability]) -> str:
    """Return what tells an effect from what it is tied with: simulated, or what is known."""
    told = [s.manoeuvre for s in separations if s.of == found.effect.name and s.distinguishes]
    known = [EFFECTS[name].manoeuvre for name in found.alternatives if name in EFFECTS]
    return "; ".join(dict.fromkeys(told or known))


def default_vehicle(simulation: SensorLog) -> NominalVehicle:
    """Return a middling car as heavy as the simulation's answer to torque says."""
    mass = min(max(effective_mass(simulation, DEFAULT_WHEEL_RADIUS) or 1600.0, 200.0), 4e4)
    return NominalVehicle(
        mass=mass,
        yaw_inertia=1.75 * mass,
        cg_to_front_axle=1.3,
        cg_to_rear_axle=1.4,
        track_width=1.6,
        wheel_radius=DEFAULT_WHEEL_RADIUS,
    )


def _notes(assumes: bool, lap: Lap | None) -> list[str]:
    notes = []
    if assumes:
        notes.append(
            "no --vehicle: masses and lengths are what the simulation shows of them, with wheels "
            f"of {DEFAULT_WHEEL_RADIUS:g} m"
        )
    if lap is None:
        notes.append("no place is passed twice: nothing can be said of what is bound to a place")
    return notes


def _activation_dict(active: ActiveEffect, lap: Lap | None) -> dict[str, Any]:
    gate = active.activation
    if gate.kind != PLACE or lap is None:
        out: dict[str, Any] = {"kind": gate.kind}
        if gate.onset_s is not None:
            out["onset_s"] = round(gate.onset_s, 3)
        return out
    line = np.column_stack([lap.line_s, lap.line])
    return {
        "kind": PLACE,
        "lap": round(lap.length, 3),
        "stretches": [[round(a, 2), round(b, 2)] for a, b in gate.segments],
        "edge": gate.transition_length,
        "line": [[round(float(x), 4) for x in row] for row in line],
    }


def _corrected_yaml(
    stand_in: SurrogateModel, verdict: Decision, h: Hypothesis, lap: Lap | None
) -> str:
    """Return the corrected model's file: stand-in, build tolerances, vehicle effects."""
    k = len(TOLERANCE_PARAMETERS)
    vector = np.clip(
        stand_in.parameters + h.tolerances[N_FIXED_NUISANCES:] @ stand_in.weak_directions,
        LOW,
        HIGH,
    )
    terms = [
        {
            "effect": a.effect.name,
            "parameters": {name: float(f"{value:.8g}") for name, value in a.values().items()},
            "where": _activation_dict(a, lap),
        }
        for a in h.actives
        # What a sensor makes up is not the vehicle's.
        if not a.effect.sensor and not a.effect.name.startswith(MARK)
    ]
    return surrogate_yaml(
        vector,
        dict(zip(TOLERANCE_PARAMETERS, (float(x) for x in h.tolerances[:k]), strict=True)),
        terms,
        _feature_terms(verdict.unmodelled, h),
        stand_in,
    )


def _feature_terms(remainder: UnmodelledDynamics | None, h: Hypothesis) -> list[dict[str, Any]]:
    if remainder is None:
        return []
    fitted = {a.effect.name: a.theta[0] for a in remainder.hypothesis.actives}
    now = {a.effect.name: a.theta[0] for a in h.actives}
    out = []
    for piece in remainder.terms:
        name = f"{MARK}{piece.equation}:{piece.feature}"
        # The same scale as when the piece was found, the coefficient as it is fitted now.
        share = now[name] / fitted[name] if fitted[name] else 1.0
        out.append(
            {
                "equation": piece.equation,
                "feature": piece.feature,
                "coefficient": float(f"{piece.coefficient * share:.8g}"),
            }
        )
    return out


def _parsed(text: str) -> SurrogateFile:
    import yaml  # type: ignore[import-untyped, unused-ignore]

    return validate("model", yaml.safe_load(text), SurrogateFile)


def _improvement(
    likelihood: Likelihood,
    stand_in: SurrogateModel,
    verdict: Decision,
    lap: Lap | None,
    scope: ObservableEffects,
) -> tuple[dict[str, float], dict[str, float], str]:
    """
    Return the errors ahead before and after, on the last part of the recording, and the model.

    What was found is fitted anew to the part before it.
    """
    course = likelihood.problem
    from_s = course.log.duration_s * (1.0 - HELD_OUT_SHARE)
    part = scope.masked(Likelihood.of(course, scope.with_yaw_filter(stand_in), from_s))
    h = verdict.hypothesis
    early = part.fit(h.actives, h.tolerances, 3, None, 1e-4)
    before = horizon_rmse(
        _parsed(surrogate_yaml(stand_in.parameters, simulator=stand_in)),
        course.log,
        HORIZON_S,
        from_s,
    )
    model = _corrected_yaml(stand_in, verdict, early, lap)
    after = horizon_rmse(_parsed(model), course.log, HORIZON_S, from_s)
    if not scope.torque:
        before[0] = after[0] = np.nan
    return _named(before), _named(after), model


def _named(values: FloatArray) -> dict[str, float]:
    return dict(zip(STATE_NAMES, (float(x) for x in values), strict=True))


def _binned(course: ResidualProblem, values: FloatArray) -> FloatArray:
    row = np.minimum(
        ((course.middle_s - course.start_s) / BIN_S + 1e-6).astype(np.int64), course.bins - 1
    )
    count = np.maximum(np.bincount(row, minlength=course.bins), 1)
    return np.asarray(np.bincount(row, values, course.bins) / count)


def _series(
    course: ResidualProblem, likelihood: Likelihood, h: Hypothesis, lap: Lap | None
) -> ResidualSeries:
    judged = likelihood.weights > 0.0
    p, terms = likelihood.simulation_inputs(h.tolerances, h.actives)
    out = course.run(p, terms)
    signals = {name: _binned(course, x) for name, x in feature_signals(course, out).items()}
    without = {}
    for i, active in enumerate(h.actives if len(h.actives) > 1 else ()):
        others = likelihood.simulation_inputs(h.tolerances, [*h.actives[:i], *h.actives[i + 1 :]])
        without[active.effect.name.removeprefix(MARK)] = judged * course.residuals(*others)
    return ResidualSeries(
        time_s=course.bin_s,
        x=_binned(course, course.pose[:, 0]),
        y=_binned(course, course.pose[:, 1]),
        signals=signals,
        before=judged * course.residuals(likelihood.parameters, likelihood.fixed_terms),
        after=judged * course.residuals(p, terms, out=out),
        noise=course.bin_noise,
        distance=None if lap is None else _binned(course, lap.unwrapped) % lap.length,
        without=without,
    )
