# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The whole way from two recordings to findings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from adk_ros.mismatch.catalogue import EFFECTS
from adk_ros.mismatch.checks import check, check_alike, check_vehicle, torque_mass
from adk_ros.mismatch.course import BIN, Course, prepare
from adk_ros.mismatch.effect import PLACE
from adk_ros.mismatch.evidence import CHANNELS, Evidence
from adk_ros.mismatch.findings import NONE, Findings, FoundEffect, Series
from adk_ros.mismatch.lap import Lap, find_lap
from adk_ros.mismatch.likelihood import (
    FIRST_OPEN,
    TOLERANCES,
    Active,
    Hypothesis,
    Likelihood,
)
from adk_ros.mismatch.manoeuvres import Separation, separate
from adk_ros.mismatch.model_file import StandInFile, content_of
from adk_ros.mismatch.nominal import Nominal
from adk_ros.mismatch.open_loop import errors_ahead
from adk_ros.mismatch.parameters import HIGH, INDEX, LOW
from adk_ros.mismatch.pieces import signals_of
from adk_ros.mismatch.rest import completed
from adk_ros.mismatch.scope import Scope, driven, filled, scope_of
from adk_ros.mismatch.search import search
from adk_ros.mismatch.standin import StandIn, identify
from adk_ros.mismatch.unknown import MARK, Remainder
from adk_ros.mismatch.verdict import Verdict, judge
from adk_ros.plant.yaml_file import validate
from adk_ros.signals.channels import STATE_NAMES, FloatArray

HORIZON_S = 1.0
WHEEL_RADIUS = 0.325
"""m, where no vehicle is given: mass and radius act as one on torque."""
OWN_ERROR = 0.5
"""Share of the error of a stand-in that was calibrated elsewhere, to be taken for noise."""
ON_ROAD = 0.8
"""Share of a recording that must lie on the simulator's road for its curves to be of use."""
HELD_OUT = 0.25
"""Last share of the recording, on which the improvement is measured."""

Progress = Callable[[float, float, str], None]


def investigate(
    simulation: Evidence | StandIn,
    recording: Evidence,
    nominal: Nominal | None = None,
    progress: Progress | None = None,
) -> Findings:
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
    recording = recording if has_imu else filled(driven(recording))
    check(recording)
    notes: list[str] = []
    if isinstance(simulation, StandIn):
        stand_in = simulation
    else:
        check(simulation)
        check_alike(simulation, recording)
        if nominal is not None:
            check_vehicle(nominal, simulation)
        tell(0.0, 10.0, "identifying the simulator")
        stand_in, notes = simulator_of(simulation, recording, nominal, tell)
    mass, radius = (float(stand_in.parameters[INDEX[k]]) for k in ("mass", "wheel_radius"))
    scope = scope_of(recording, mass, radius, has_imu)
    known = isinstance(simulation, StandIn)
    # Much of a calibrated model's own error would be cut off as outliers of a quiet sensor.
    own = OWN_ERROR * stand_in.error if known else np.zeros(6)
    course = prepare(recording, np.maximum(recording.noise(), own))
    lap = find_lap(course)
    likelihood = scope.narrowed(Likelihood.of(course, scope.stand_in(stand_in)))
    found = search(
        likelihood, lap, lambda done, total, text: tell(2.0 + 5.0 * done / total, 10.0, text)
    )
    tell(7.0, 10.0, "judging rivals")
    verdict = scope.modest(judge(likelihood, found), likelihood, found)
    tell(9.0, 10.0, "driving on held-out data")
    corrected = _corrected(stand_in, verdict, verdict.hypothesis, lap)
    before, after, early = _improvement(likelihood, stand_in, verdict, lap, scope)
    groups = [[e.effect.name, *e.alternatives] for e in verdict.effects if e.alternatives]
    separations = _separations(stand_in, verdict, course)
    suggestions = [_next_drive(e, separations) for e in verdict.effects if e.alternatives]
    tell(10.0, 10.0, "done")
    effects = [replace(e, lap_m=None if lap is None else lap.length) for e in verdict.effects]
    return Findings(
        effects=effects,
        verdict=verdict.word, unexplained=verdict.unexplained,
        horizon_s=HORIZON_S, before=before, after=after, groups=groups,
        suggestion="; ".join(dict.fromkeys(s for s in suggestions if s)),
        simulation_yaml=content_of(stand_in.parameters, simulator=stand_in),
        corrected_yaml=corrected,
        series=_series(course, likelihood, verdict.hypothesis, lap),
        stand_in_error=dict(zip(CHANNELS, (float(x) for x in stand_in.error), strict=True)),
        losses=[("+".join(level[0].names) or NONE, level[0].cost) for level in found.levels],
        level=found.noise, lap_m=None if lap is None else lap.length, maps=found.maps,
        notes=notes + _notes(nominal is None and not known, lap),
        held_out_yaml=early, lacking=scope.lacking(),
        not_judged=sorted(scope.beyond & set(EFFECTS)), separations=separations,
    )


def simulator_of(
    simulation: Evidence, recording: Evidence, nominal: Nominal | None, tell: Progress
) -> tuple[StandIn, list[str]]:
    """Return the simulator's stand-in, with what acts where the recording drives, and notes."""
    course, known = prepare(simulation), nominal is not None
    begun = (nominal or assumed(simulation)).parameters()
    plain = identify(
        course, begun,
        lambda done, total: tell(done / total, 10.0, "identifying the simulator"), known,
    )
    whole = completed(
        course, plain, begun, known,
        lambda done, total: tell(1.0 + done / total, 10.0, "learning the rest of the simulator"),
    )
    if whole.road is not None and whole.road.share(prepare(recording)) < ON_ROAD:
        return plain, [
            "the simulated road was learned, but the recording drives another, or its poses have "
            "another origin: nothing of it is used"
        ]
    if not whole.learned:
        return plain, []
    return whole, [
        "tyres and body alone do not meet the simulation; what was learned of it besides: "
        f"{'; '.join(whole.learned)}"
    ]


def _separations(stand_in: StandIn, verdict: Verdict, course: Course) -> list[Separation]:
    """Return for each pair that the drive cannot tell apart what would, if anything."""
    actives = [a for a in verdict.hypothesis.actives if not a.effect.name.startswith(MARK)]
    place = {a.effect.name: i for i, a in enumerate(actives)}
    return [
        separate(
            stand_in.parameters, actives, place[found.effect.name], rival.fitted, course.bin_noise
        )
        for found in verdict.effects if found.effect.name in place
        for rival in found.rivals if rival.alternative
    ]


def _next_drive(found: FoundEffect, separations: list[Separation]) -> str:
    """Return what tells an effect from what it is tied with: simulated, or what is known."""
    told = [s.manoeuvre for s in separations if s.of == found.effect.name and s.tells]
    known = [EFFECTS[name].manoeuvre for name in found.alternatives if name in EFFECTS]
    return "; ".join(dict.fromkeys(told or known))


def assumed(simulation: Evidence) -> Nominal:
    """Return a middling car as heavy as the simulation's answer to torque says."""
    mass = min(max(torque_mass(simulation, WHEEL_RADIUS) or 1600.0, 200.0), 4e4)
    return Nominal(
        mass=mass, yaw_inertia=1.75 * mass, cg_to_front_axle=1.3, cg_to_rear_axle=1.4,
        track_width=1.6, wheel_radius=WHEEL_RADIUS,
    )


def _notes(assumes: bool, lap: Lap | None) -> list[str]:
    notes = []
    if assumes:
        notes.append(
            "no --vehicle: masses and lengths are what the simulation shows of them, with wheels "
            f"of {WHEEL_RADIUS:g} m"
        )
    if lap is None:
        notes.append(
            "no place is passed twice: nothing can be said of what is bound to a place"
        )
    return notes


def _where(active: Active, lap: Lap | None) -> dict[str, Any]:
    gate = active.gate
    if gate.kind != PLACE or lap is None:
        out: dict[str, Any] = {"kind": gate.kind}
        if gate.onset_s is not None:
            out["onset_s"] = round(gate.onset_s, 3)
        return out
    line = np.column_stack([lap.line_s, lap.line])
    return {
        "kind": PLACE,
        "lap": round(lap.length, 3),
        "stretches": [[round(a, 2), round(b, 2)] for a, b in gate.stretches],
        "edge": gate.edge,
        "line": [[round(float(x), 4) for x in row] for row in line],
    }


def _corrected(
    stand_in: StandIn, verdict: Verdict, h: Hypothesis, lap: Lap | None
) -> str:
    """Return the corrected model's file: stand-in, build tolerances, vehicle effects."""
    k = len(TOLERANCES)
    vector = np.clip(stand_in.parameters + h.tolerances[FIRST_OPEN:] @ stand_in.unsure, LOW, HIGH)
    terms = [
        {
            "effect": a.effect.name,
            "parameters": {name: float(f"{value:.8g}") for name, value in a.values().items()},
            "where": _where(a, lap),
        }
        for a in h.actives
        # What a sensor makes up is not the vehicle's.
        if not a.effect.sensor and not a.effect.name.startswith(MARK)
    ]
    return content_of(
        vector, dict(zip(TOLERANCES, (float(x) for x in h.tolerances[:k]), strict=True)), terms,
        _correction(verdict.remainder, h), stand_in,
    )


def _correction(remainder: Remainder | None, h: Hypothesis) -> list[dict[str, Any]]:
    if remainder is None:
        return []
    fitted = {a.effect.name: a.inner[0] for a in remainder.hypothesis.actives}
    now = {a.effect.name: a.inner[0] for a in h.actives}
    out = []
    for piece in remainder.pieces:
        name = f"{MARK}{piece.equation}:{piece.feature}"
        # The same scale as when the piece was found, the coefficient as it is fitted now.
        share = now[name] / fitted[name] if fitted[name] else 1.0
        out.append({
            "equation": piece.equation, "feature": piece.feature,
            "coefficient": float(f"{piece.coefficient * share:.8g}"),
        })
    return out


def _parsed(text: str) -> StandInFile:
    import yaml  # type: ignore[import-untyped, unused-ignore]

    return validate("model", yaml.safe_load(text), StandInFile)


def _improvement(
    likelihood: Likelihood, stand_in: StandIn, verdict: Verdict, lap: Lap | None, scope: Scope
) -> tuple[dict[str, float], dict[str, float], str]:
    """
    Return the errors ahead before and after, on the last part of the recording, and the model.

    What was found is fitted anew to the part before it.
    """
    course = likelihood.course
    from_s = course.evidence.duration_s * (1.0 - HELD_OUT)
    part = scope.narrowed(Likelihood.of(course, scope.stand_in(stand_in), from_s))
    h = verdict.hypothesis
    early = part.fit(h.actives, h.tolerances, 3, None, 1e-4)
    before = errors_ahead(
        _parsed(content_of(stand_in.parameters, simulator=stand_in)), course.evidence, HORIZON_S,
        from_s,
    )
    model = _corrected(stand_in, verdict, early, lap)
    after = errors_ahead(
        _parsed(model), course.evidence, HORIZON_S, from_s
    )
    if not scope.torque:
        before[0] = after[0] = np.nan
    return _named(before), _named(after), model


def _named(values: FloatArray) -> dict[str, float]:
    return dict(zip(STATE_NAMES, (float(x) for x in values), strict=True))


def _binned(course: Course, values: FloatArray) -> FloatArray:
    row = np.minimum(
        ((course.middle_s - course.start_s) / BIN + 1e-6).astype(np.int64), course.bins - 1
    )
    count = np.maximum(np.bincount(row, minlength=course.bins), 1)
    return np.asarray(np.bincount(row, values, course.bins) / count)


def _series(
    course: Course, likelihood: Likelihood, h: Hypothesis, lap: Lap | None
) -> Series:
    judged = likelihood.weights > 0.0
    p, terms = likelihood.setting(h.tolerances, h.actives)
    out = course.run(p, terms)
    signals = {name: _binned(course, x) for name, x in signals_of(course, out).items()}
    without = {}
    for i, active in enumerate(h.actives if len(h.actives) > 1 else ()):
        others = likelihood.setting(h.tolerances, [*h.actives[:i], *h.actives[i + 1 :]])
        without[active.effect.name.removeprefix(MARK)] = judged * course.residuals(*others)
    return Series(
        time_s=course.bin_s, x=_binned(course, course.pose[:, 0]),
        y=_binned(course, course.pose[:, 1]), signals=signals,
        before=judged * course.residuals(likelihood.parameters, likelihood.given),
        after=judged * course.residuals(p, terms, out=out),
        noise=course.bin_noise,
        distance=None if lap is None else _binned(course, lap.unwrapped) % lap.length,
        without=without,
    )
