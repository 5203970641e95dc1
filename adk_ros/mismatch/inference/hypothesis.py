# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hypothesis: effects with their fitted variables and where they act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.surrogate.activation import ALWAYS_ACTIVE, Activation
from adk_ros.mismatch.surrogate.residuals import ResidualProblem
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.levenberg_marquardt import FitResult, huber_loss


@dataclass(frozen=True)
class ActiveEffect:
    """An effect with its fitted variables `theta`, one per parameter, and its activation."""

    effect: Effect
    theta: tuple[float, ...]
    activation: Activation = ALWAYS_ACTIVE

    def values(self) -> dict[str, float]:
        """Return parameter name -> value in the parameter's unit."""
        return {
            parameter.name: parameter.value(x)
            for parameter, x in zip(self.effect.parameters, self.theta, strict=True)
        }

    def is_material(self) -> bool:
        """Whether any parameter exceeds its materiality threshold."""
        return any(
            parameter.is_material(x)
            for parameter, x in zip(self.effect.parameters, self.theta, strict=True)
        )


@dataclass(frozen=True)
class Hypothesis:
    """
    Effects with a fit: nuisance parameters, loss (with the prior's), and the fit itself.

    `losses_by_direction` (2,): those of the longitudinal and of the lateral channels, if fitted.
    """

    effects: tuple[ActiveEffect, ...]
    nuisances: FloatArray
    loss: float
    fit: FitResult | None = None
    losses_by_direction: FloatArray | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(active.effect.name for active in self.effects)

    @property
    def prior_cost(self) -> float:
        """Part of the loss that is the prior's: how unusual the nuisance parameters are."""
        assert self.fit is not None
        return self.loss - huber_loss(self.fit.residuals)


def with_parameters(
    effects: Sequence[ActiveEffect], values: FloatArray, fit_activation: bool = False
) -> list[ActiveEffect]:
    """Return the effects with their fitted variables, and those of activations, replaced."""
    out, remaining = [], [float(v) for v in values]
    for active in effects:
        count = len(active.theta)
        theta, remaining = tuple(remaining[:count]), remaining[count:]
        activation = active.activation
        if fit_activation:
            count = len(activation.variables())
            activation = activation.with_variables(remaining[:count])
            remaining = remaining[count:]
        out.append(ActiveEffect(active.effect, theta, activation))
    return out


def inactive_effect(effect: Effect, activation: Activation = ALWAYS_ACTIVE) -> ActiveEffect:
    """Return an effect at its neutral values."""
    return ActiveEffect(effect, tuple(p.theta_neutral for p in effect.parameters), activation)


def road_friction(effects: Sequence[ActiveEffect], problem: ResidualProblem) -> FloatArray | None:
    """
    Return the road's friction (b,) over that of the simulation, or None without such an effect.

    Where it acts at places that are not known along this recording, it counts everywhere.
    """
    found = [active for active in effects if active.effect.name == "low_friction"]
    if not found:
        return None
    factor = np.ones(problem.bins)
    for active in found:
        distance = active.activation.distance
        is_known = distance is None or distance.shape == (problem.steps,)
        weight = active.activation.series(problem) if is_known else np.ones(problem.steps)
        factor *= 1.0 + (active.values()["mu_scale"] - 1.0) * problem.binned(weight)
    return factor
