# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a drive cannot tell apart: for each effect found, others that would explain as much.

Each rival takes the effect's place in the hypothesis and is fitted. It is an alternative if its
loss is no more than a margin above: the margin is what chance allows, plus what the inexact form
of the effect's equation allows (a share of what the effect explains). Some pairs are the same
physics on any drive, and are alternatives in any case.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.likelihood import ActiveEffect, Hypothesis, Likelihood
from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import ALWAYS, PLACE, Effect

INDISTINGUISHABLE_LOSS = 12.0
INDISTINGUISHABLE_LOSS_SHARE = 2e-4
_MAX_COMPETITORS = 4
_QUICK_ITERATIONS = 5

STRUCTURALLY_EQUIVALENT: dict[str, tuple[str, ...]] = {
    "drive_torque_gain": ("wheel_radius",),
    "wheel_radius": ("drive_torque_gain",),
}
"""What no drive of one car can tell apart."""


@dataclass(frozen=True)
class CompetingEffect:
    """A hypothesis that was beaten by `behind` in loss, with another effect in one's place."""

    of: str
    name: str
    loss_difference: float
    fitted: ActiveEffect
    alternative: bool


@dataclass(frozen=True)
class Identifiability:
    """How sure an effect is: what its absence would cost, and its rivals, closest first."""

    gain: float
    competitors: tuple[CompetingEffect, ...]

    @property
    def alternatives(self) -> list[str]:
        """Names that the data cannot tell from it."""
        return [rival.name for rival in self.competitors if rival.alternative]

    def confidence(self) -> float:
        """Return the share of belief, between 0 and 1, that the name is the right one."""
        scale = (
            2.0 * (1.0 + INDISTINGUISHABLE_LOSS_SHARE * self.gain / INDISTINGUISHABLE_LOSS) * 3.0
        )
        others = sum(float(np.exp(-max(r.loss_difference, 0.0) / scale)) for r in self.competitors)
        chance = float(np.exp(-max(self.gain, 0.0) / 20.0))
        return min(0.99, 1.0 / (1.0 + others + chance))


def assess_identifiability(likelihood: Likelihood, h: Hypothesis, which: int) -> Identifiability:
    """Return how sure effect `which` of a hypothesis is."""
    active = h.actives[which]
    others = [a for i, a in enumerate(h.actives) if i != which]
    without = likelihood.fit(others, h.tolerances, 6, None, 1e-4)
    gain = without.cost - h.cost
    margin = INDISTINGUISHABLE_LOSS + INDISTINGUISHABLE_LOSS_SHARE * max(gain, 0.0)
    known = likelihood.nuisance_jacobian(h)
    screen = LinearisedProblem(likelihood, without, likelihood.nuisance_jacobian(without))
    scope = PLACE if active.activation.kind == PLACE else ALWAYS
    tried: list[tuple[float, ActiveEffect]] = []
    taken = {a.effect.name for a in h.actives} | likelihood.unobservable
    for effect in EFFECTS.values():
        if effect.name in taken or scope not in effect.activations:
            continue
        first = screen.screen_effect(effect, active.activation)[0]
        likely = (
            effect.name in active.effect.confusables
            or effect.name in STRUCTURALLY_EQUIVALENT.get(active.effect.name, ())
        )
        tried.append((first.gain * (4.0 if likely else 1.0), first.active))
    tried.sort(key=lambda x: -x[0])
    rivals = []
    for _, start in tried[:_MAX_COMPETITORS]:
        fitted = likelihood.fit([*others, start], h.tolerances, _QUICK_ITERATIONS, known, 1e-5)
        behind = fitted.cost - h.cost
        if behind < 20.0 * margin:
            fitted = likelihood.fit(fitted.actives, fitted.tolerances, 6, None, 1e-5)
            behind = fitted.cost - h.cost
        name = start.effect.name
        same = name in STRUCTURALLY_EQUIVALENT.get(active.effect.name, ())
        rival = fitted.actives[-1]
        near = (
            (behind < margin or same)
            and rival.is_material()
            and not has_inactive_parameter(rival, active)
        )
        if has_inactive_parameter(rival, active):
            behind += margin
        rivals.append(CompetingEffect(active.effect.name, name, behind, rival, near))
    rivals.sort(key=lambda r: r.loss_difference)
    return Identifiability(gain, tuple(rivals))


def has_inactive_parameter(rival: ActiveEffect, than: ActiveEffect) -> bool:
    """
    Whether a rival does as well only with more parameters, one of which does nothing.

    A bias of the IMU that spares the gyro is as good as a tilt; but why should it spare it?
    """
    if len(rival.theta) <= len(than.theta):
        return False
    return not all(
        parameter.is_material(x)
        for parameter, x in zip(rival.effect.parameters, rival.theta, strict=True)
    )


def canonical_effect(active: ActiveEffect, deviation: tuple[float, ...]) -> Effect:
    """
    Return the effect that an equal one is rather called by.

    A bias that the gyro does not share is as good as a tilt, and a tilt has no gyro bias.
    """
    if active.effect.name == "imu_bias":
        gyro = active.effect.parameters[2]
        if not gyro.is_material(active.theta[2]) or abs(active.theta[2]) < 3.0 * deviation[2]:
            return EFFECTS["imu_tilt"]
    return active.effect
