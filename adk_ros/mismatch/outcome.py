# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Outcome of a mismatch analysis, and its description as a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from adk_ros.mismatch.deployment.corrected_model import corrected_yaml
from adk_ros.mismatch.deployment.held_out import HORIZONS_S, REPORTED_HORIZON, Evidence
from adk_ros.mismatch.deployment.predicted_signals import predicted_signals, unpredicted_signals
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.export_choice import exported
from adk_ros.mismatch.inference.asked_effect import AskedEffect
from adk_ros.mismatch.inference.candidates import rejected_candidates
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.downweighted import note_on
from adk_ros.mismatch.inference.downweighted_episodes import Downweighted
from adk_ros.mismatch.inference.experiment_design import (
    Discriminability,
    most_discriminating_manoeuvre,
)
from adk_ros.mismatch.inference.feature_effect import catalogue_effects
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import IdentifiedEffect, MismatchResult
from adk_ros.mismatch.inference.selection_path import SelectionPath, selection_steps
from adk_ros.mismatch.inference.steady_state import steady_state
from adk_ros.mismatch.inputs import Inputs
from adk_ros.mismatch.leave_one_out import agreement_of
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.residual_series import residual_series
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import ResidualProblem
from adk_ros.mismatch.validation import Validation, held_out_result


@dataclass(frozen=True)
class Outcome:
    """
    What was decided, from which selection, and how it held on held-out data.

    `training`, `whole`: likelihoods of the part that was selected on, and of all data.
    """

    path: SelectionPath
    decision: Decision
    training: Likelihood
    whole: Likelihood
    validation: Validation
    evidence: Sequence[Evidence]
    downweighted: Downweighted | None
    asked: Sequence[AskedEffect]

    def described(self, inputs: Inputs) -> MismatchResult:
        """Return the result with its tables, series and models."""
        decision, validation, path = self.decision, self.validation, self.path
        surrogate, data = inputs.surrogate, inputs.data
        lap_m = data.single_lap.length if data.single_lap is not None else None
        simulated = simulation_yaml(surrogate)
        correction = exported(decision.hypothesis, validation.export)
        discriminability = _discriminability(surrogate, decision, data.problem)
        tied = [e for e in decision.effects if e.alternatives]
        suggestions = [_suggested_manoeuvre(e, discriminability) for e in tied]
        return MismatchResult(
            effects=[
                replace(e, lap_m=lap_m, recordings=data.recordings) for e in decision.effects
            ],
            verdict=decision.verdict,
            unexplained=decision.unexplained,
            set_aside=list(decision.set_aside),
            horizon_s=HORIZONS_S[REPORTED_HORIZON],
            before=validation.errors.at(validation.errors.before),
            after=validation.errors.at(validation.errors.after),
            groups=[[e.effect.name, *e.alternatives] for e in tied],
            suggestion="; ".join(dict.fromkeys(s for s in suggestions if s)),
            simulation_yaml=simulated,
            corrected_yaml=(
                simulated
                if correction is None
                else corrected_yaml(surrogate, correction, data.lap)
            ),
            series=residual_series(self.whole, decision.hypothesis, data.lap),
            surrogate_error=dict(zip(CHANNELS, map(float, surrogate.error), strict=True)),
            steps=selection_steps(path),
            expected_loss=path.expected_loss,
            surrogate_error_dof=path.surrogate_error_dof,
            surrogate_variance_share=self.whole.surrogate_variance_share(),
            lap_m=lap_m,
            profiles=path.profiles if lap_m else [],
            notes=[*inputs.notes, *note_on(self.downweighted)],
            held_out_yaml=validation.held_out_yaml,
            missing_channels=data.observable.missing_channels(),
            not_judged=sorted(data.observable.unobservable & set(EFFECTS)),
            discriminability=discriminability,
            held_out=held_out_result(validation, self.evidence),
            candidates=rejected_candidates(self.training, path, decision),
            direct=data.direct_comparisons(inputs.simulation),
            asked=list(self.asked),
            signals=predicted_signals(
                (simulated, validation.held_out_yaml),
                self.evidence[0],
                held_out_result(validation, self.evidence[:1]).source,
                unpredicted_signals(data.observable.torque, inputs.has_imu),
            ),
            downweighted=self.downweighted,
            steady_state=steady_state(self.whole, decision.hypothesis, data.observable.torque),
            agreement=agreement_of(data, decision, self.whole, path),
            scope=data.observable.scope(inputs.scope),
            sensors=data.problem.log.sensors,
            road=data.problem.log.road,
        )


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
