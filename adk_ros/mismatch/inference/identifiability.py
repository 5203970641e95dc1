# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Identifiability: which other effects explain a recording as well as an identified one.

Each competing effect takes the identified effect's place in the hypothesis and is fitted. It is an
alternative if its loss exceeds the identified one's by less than `INDISTINGUISHABLE_LOSS`,
tempered as in `inference.confidence`. Structurally equivalent effects are alternatives on any
recording.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from adk_ros.mismatch.inference.block_scores import BlockScores
from adk_ros.mismatch.inference.confidence import ABSENT, ConfidenceModel
from adk_ros.mismatch.inference.fit_budget import ABLATION, COMPETITOR, COMPETITOR_REFIT
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.score_test import Candidate, LinearisedProblem
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import (
    GYRO_BIAS_SIGMAS,
    INDISTINGUISHABLE_LOSS,
)
from adk_ros.mismatch.library.effect import ALWAYS, PLACE, Effect
from adk_ros.mismatch.library.search_limits import (
    COMPETITOR_REFIT_MARGINS,
    CONFUSABLE_GAIN_FACTOR,
    MAX_COMPETITORS,
)
from adk_ros.numerics.arrays import FloatArray

STRUCTURALLY_EQUIVALENT: dict[str, tuple[str, ...]] = {
    "drive_torque_gain": ("wheel_radius",),
    "wheel_radius": ("drive_torque_gain",),
    "rolling_resistance": ("torque_offset",),
    "torque_offset": ("rolling_resistance",),
}
"""
Effects that no recording of the same channels can distinguish: above walking pace, a rolling
resistance and a constant torque are the same constant force, and what makes one of them fit better
is the surrogate's own error.
"""
_SEPARATE_SHARE = 0.5
"""
An effect that gains the greater part of its gain also next to an immaterial one, such as a delay
of a millisecond, explains something else: the immaterial one is no alternative to it.
"""
_DIRECTIONS = {"v_x": "longitudinal", "v_y": "lateral", "yaw_rate": "lateral"}


@dataclass(frozen=True)
class CompetingEffect:
    """Effect `name`, fitted in place of effect `of`; `loss_difference` above the latter's loss."""

    of: str
    name: str
    loss_difference: float
    fitted: ActiveEffect
    alternative: bool


class LeftOutScores(NamedTuple):
    """Losses (b,) of a fit on blocks left out, and the prior's cost of its nuisance parameters."""

    losses: FloatArray
    prior_cost: float

    @classmethod
    def of(cls, likelihood: Likelihood, h: Hypothesis) -> LeftOutScores:
        """Return the scores of a fitted hypothesis."""
        return cls(BlockScores.of(likelihood, h).left_out_losses(), h.prior_cost)

    @property
    def total(self) -> float:
        """Loss on all blocks, each left out, with the prior's cost."""
        return float(self.losses.sum()) + self.prior_cost


@dataclass(frozen=True)
class Identifiability:
    """
    The loss an effect saves, and its competing effects, closest first.

    `scores`: those with the effect; `competitor_scores`: name and scores of what may be in its
    place, a competing effect or none.
    """

    gain: float
    competitors: tuple[CompetingEffect, ...]
    scores: LeftOutScores
    competitor_scores: tuple[tuple[str, LeftOutScores], ...]

    @property
    def alternatives(self) -> list[str]:
        """Names of effects that the data do not distinguish from it."""
        return [competitor.name for competitor in self.competitors if competitor.alternative]

    @property
    def alternatives_to(self) -> tuple[tuple[str, LeftOutScores], ...]:
        """Name and scores of what may be in its place, if the data distinguish it."""
        tied = self.alternatives
        return tuple((name, scores) for name, scores in self.competitor_scores if name not in tied)

    def without_alternatives(self, refused: Collection[tuple[str, str]]) -> Identifiability:
        """Return it with competitors (of, name) that are no alternatives, whatever their loss."""
        competitors = tuple(
            replace(c, alternative=c.alternative and (c.of, c.name) not in refused)
            for c in self.competitors
        )
        return replace(self, competitors=competitors)

    def without_competitors(self, names: Collection[str]) -> Identifiability:
        """Return it without the competitors of these names, which are not in its place."""
        return replace(
            self,
            competitors=tuple(c for c in self.competitors if c.name not in names),
            competitor_scores=tuple(x for x in self.competitor_scores if x[0] not in names),
        )


def assess_identifiability(likelihood: Likelihood, h: Hypothesis, which: int) -> Identifiability:
    """Fit the most similar effects in place of effect `which` of a hypothesis."""
    active = h.effects[which]
    others = [a for i, a in enumerate(h.effects) if i != which]
    without = likelihood.fit(others, nuisances=h.nuisances, budget=ABLATION)
    gain = without.loss - h.loss
    tempering = ConfidenceModel().tempering(likelihood.surrogate_error_dof())
    margin = INDISTINGUISHABLE_LOSS * tempering
    jacobian = likelihood.nuisance_jacobian(h)
    linearised = LinearisedProblem(likelihood, without, likelihood.nuisance_jacobian(without))
    excluded = {a.effect.name for a in h.effects} | likelihood.unobservable
    equivalent = STRUCTURALLY_EQUIVALENT.get(active.effect.name, ())
    competitors = []
    scores = {ABSENT: LeftOutScores.of(likelihood, without)}
    for candidate in _similar_effects(linearised, active, excluded)[:MAX_COMPETITORS]:
        fitted = likelihood.fit(
            [*others, candidate.active],
            nuisances=h.nuisances,
            budget=COMPETITOR,
            jacobian=jacobian,
        )
        difference = fitted.loss - h.loss
        if difference < COMPETITOR_REFIT_MARGINS * margin:
            fitted = likelihood.fit(
                fitted.effects, nuisances=fitted.nuisances, budget=COMPETITOR_REFIT
            )
            difference = fitted.loss - h.loss
        name = candidate.active.effect.name
        competitor = fitted.effects[-1]
        if not competitor.is_material() and difference < margin:
            both = likelihood.fit(
                [*fitted.effects, active], nuisances=fitted.nuisances, budget=COMPETITOR_REFIT
            )
            if fitted.loss - both.loss > _SEPARATE_SHARE * gain:
                continue
        overparameterised = has_inactive_parameter(competitor, active)
        alternative = (
            (difference < margin or name in equivalent)
            and competitor.is_material()
            and not overparameterised
        )
        if overparameterised:
            difference += margin
        if not overparameterised:
            scores[name] = LeftOutScores.of(likelihood, fitted)
        competitors.append(
            CompetingEffect(active.effect.name, name, difference, competitor, alternative)
        )
    competitors.sort(key=lambda c: c.loss_difference)
    own = LeftOutScores.of(likelihood, h)
    return Identifiability(gain, tuple(competitors), own, tuple(scores.items()))


def _similar_effects(
    linearised: LinearisedProblem, active: ActiveEffect, excluded: set[str]
) -> list[Candidate]:
    """Return effects with the same activation, by linearised gain; confusable ones count more."""
    kind = PLACE if active.activation.kind == PLACE else ALWAYS
    likely = {
        *active.effect.confusables,
        *STRUCTURALLY_EQUIVALENT.get(active.effect.name, ()),
    }
    candidates = []
    for effect in linearised.likelihood.effects.values():
        if effect.name in excluded or kind not in effect.activations:
            continue
        if act_apart(effect, active.effect):
            continue
        first = linearised.screen_effect(effect, active.activation)[0]
        factor = CONFUSABLE_GAIN_FACTOR if effect.name in likely else 1.0
        candidates.append(Candidate(first.active, first.gain * factor))
    return sorted(candidates, key=lambda x: -x.gain)


def act_apart(one: Effect, other: Effect) -> bool:
    """
    Whether one effect acts along the car alone, and the other to its side alone.

    Neither explains what the other does, however much each gains.
    """
    directions = [{_DIRECTIONS.get(name) for name in x.equations} for x in (one, other)]
    return not any(None in x for x in directions) and not directions[0] & directions[1]


def has_inactive_parameter(competitor: ActiveEffect, active: ActiveEffect) -> bool:
    """
    Whether a competing effect has more parameters than `active`, one of them not significant.

    Such an effect is as good only by its additional parameter: an IMU bias without gyro part
    equals a tilt.
    """
    if len(competitor.theta) <= len(active.theta):
        return False
    return not all(
        parameter.is_material(x)
        for parameter, x in zip(competitor.effect.parameters, competitor.theta, strict=True)
    )


def canonical_effect(active: ActiveEffect, deviation: Sequence[float]) -> Effect:
    """
    Return the effect with fewer parameters that an effect is equivalent to, or itself.

    An IMU bias without a significant gyro part is a tilt. `deviation`: standard deviations of the
    fitted variables.
    """
    if active.effect.name == "imu_bias":
        gyro, bias = active.effect.parameters[2], active.theta[2]
        if not gyro.is_material(bias) or abs(bias) < GYRO_BIAS_SIGMAS * deviation[2]:
            return EFFECTS["imu_tilt"]
    return active.effect
