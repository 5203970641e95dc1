# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mismatch analysis: from a simulation and a recording to a result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from adk_ros.mismatch.deployment.held_out import Evidence
from adk_ros.mismatch.fitted_tolerances import with_fitted_tolerances
from adk_ros.mismatch.inference.confirmation import confirmed, is_formula_confirmed
from adk_ros.mismatch.inference.corroboration import is_corroborated
from adk_ros.mismatch.inference.decision import Decision, decide
from adk_ros.mismatch.inference.downweighted import (
    downweighted_residuals,
    episodes_describe_more,
    with_episodes,
)
from adk_ros.mismatch.inference.final_estimate import (
    formula_instead,
    refitted,
    with_confidence,
    without_improbable,
)
from adk_ros.mismatch.inference.forward_selection import select_effects
from adk_ros.mismatch.inference.question import Questioned, answer
from adk_ros.mismatch.inference.result import UNKNOWN, MismatchResult
from adk_ros.mismatch.inputs import Inputs
from adk_ros.mismatch.library.criteria import HELD_OUT_SHARE
from adk_ros.mismatch.library.sensitivity import recorded_decisions
from adk_ros.mismatch.not_judged import not_judged
from adk_ros.mismatch.outcome import Outcome
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.road_by_ins import levelled
from adk_ros.mismatch.slopes_beyond_simulation import without_places_on_slopes
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.validation import Validation, coherent, validate_on_held_out
from adk_ros.mismatch.withdrawal import (
    described_by_errors,
    is_contradicted,
    is_refuted,
    nothing_missing,
    nothing_named,
    withdrawn,
)

Progress = Callable[[float, float, str], None]
_TOTAL = 10.0
_IDENTIFIED, _SELECTED, _DECIDED = 2.0, 7.0, 9.0
"""Progress, of `_TOTAL`, after the stages of an analysis."""
_NOT_CORROBORATED = "no effect and no formula describes it in two measured channels"
_UNDESCRIBED = "no effect and no formula describes it"
_REFUTED = "no effect and no formula removes half of the avoidable squared error on held-out data"
"""Why nothing is claimed of a difference of unknown cause."""


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
    sizes are selected on the part before the last quarter of each recording; this quarter measures
    the improvement, and may withdraw what was selected. With `held_out` recordings, they are
    selected on all of `recording`. The reported sizes are then fitted to all of it. The simulation
    may be a surrogate that is already identified. Without an IMU or a torque command, fewer
    effects are examined (see `inference.observability`); without any command, none is (see
    `not_judged`).
    Without a `nominal` vehicle, mass and lengths are identified from the simulation as far as
    possible. `progress` is called with (done, total, stage).
    `ask`: effects of the catalogue, to be answered why they are claimed or not.

    Raises `DataError` for recordings that do not allow an analysis.
    """
    report = progress or (lambda done, total, text: None)
    with recorded_decisions() as decisions:
        inputs = Inputs.of(
            simulation,
            [recording] if isinstance(recording, SensorLog) else list(recording),
            nominal,
            0.0 if held_out else HELD_OUT_SHARE,
            lambda done, text: report(_IDENTIFIED * done, _TOTAL, text),
        )
        if not inputs.data.observable.is_excited:
            report(_TOTAL, _TOTAL, "done")
            return not_judged(inputs, ask)
        outcome = _decided(inputs, report, held_out, ask)
    report(_TOTAL, _TOTAL, "done")
    return replace(outcome.described(inputs), decisions=decisions)


def _decided(
    inputs: Inputs, report: Progress, held_out: Sequence[SensorLog], ask: Sequence[str]
) -> Outcome:
    """Select effects on the training part, validate them, and fit the rest to all data."""
    surrogate, data = inputs.surrogate, inputs.data
    training, whole, lap = data.training(), data.whole(), data.lap
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
    if not held_out:
        decision = confirmed(decision, training, whole, path)
    null, reason = path.levels[0][0], ""
    if decision.excess_is_small and not is_formula_confirmed(
        decision.hypothesis, null, training, whole
    ):
        decision = nothing_missing(null)
    evidence = [data.evidence(inputs.completed(log)) for log in held_out]
    evidence = evidence or data.held_out(decision.hypothesis)

    def judged(decision: Decision) -> list[Evidence]:
        along = training.along_weak_directions(decision.hypothesis.nuisances)
        return levelled(evidence, along, training.weak_directions)

    def validated(decision: Decision) -> Validation:
        return validate_on_held_out(
            surrogate, decision.hypothesis, lap, judged(decision), data.not_predicted()
        )

    decision = without_places_on_slopes(decision, training, path, evidence, validated)
    decision = formula_instead(decision)
    if not is_corroborated(decision.hypothesis, training, whole, path.expected_loss):
        decision = withdrawn(decision, null)
        reason = _NOT_CORROBORATED if nothing_named(decision) else ""
    known = data.observable.adapted(surrogate)
    rare = episodes_describe_more(
        training,
        decision.hypothesis,
        null,
        known,
        data.single_lap,
        of_time_only=not decision.excess_is_small,
    )
    if rare:
        decision = withdrawn(decision, null)

    def checked(decision: Decision) -> Validation:
        return with_fitted_tolerances(
            validated(decision), decision, surrogate, training, lap, judged(decision)
        )

    validation = checked(decision)
    if is_contradicted(decision, validation):
        decision = nothing_missing(null)
        validation = checked(decision)
    decision = coherent(decision, validation)
    if is_refuted(decision, validation):
        decision = withdrawn(decision, null)
        validation = checked(decision)
        decision = coherent(decision, validation)
        reason = _REFUTED if nothing_named(decision) else ""
    # Without any prediction, the result says that nothing confirms its effects.
    if validation.errors.starts:
        decision = without_improbable(decision, validation.error_ratio)
    about = Questioned(training, path, decision, lap, surrogate.parameters)
    asked = [answer(name, about) for name in ask]
    evidence = judged(decision)
    decision = with_confidence(refitted(decision, whole), validation.error_ratio)
    hidden = downweighted_residuals(whole, decision.hypothesis, known, data.single_lap)
    is_rule = hidden is not None and hidden.is_rule
    describes = hidden is not None and hidden.describes(decision.verdict == UNKNOWN and not rare)
    episodic = describes and not is_rule
    if (rare or is_rule) and not episodic and nothing_named(decision):
        reason = reason or _UNDESCRIBED
    if reason:
        decision = described_by_errors(decision, validation, reason)
    if episodic or (describes and not reason):
        decision = with_episodes(decision, hidden, keep_text=bool(reason))
    return Outcome(path, decision, training, whole, validation, evidence, hidden, asked)
