# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Required size: that from which an effect would be claimed, and the driving that it would take.

With s the size and sigma its standard deviation next to all other fitted parameters, the gain of a
present effect is about (s / sigma)^2, since a loss difference is twice a log-likelihood ratio.
The size from which it would be claimed on this recording is where this gain is the required one
and the size is significant. The required gain depends on the size too, through the excess loss
that the effect causes. On k times as much driving of the same kind, gain, excess losses and
surrogate error are k times as large; the fixed part of the required gain is not, and what chance
adds to the excess loss grows with the root of k.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.inference.block_scores import BlockScores, effect_variables
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.selection_path import (
    SelectionPath,
    only_direction,
    required_gain_of,
)
from adk_ros.mismatch.inference.significance import least_significant
from adk_ros.mismatch.library.effect import Effect
from adk_ros.numerics.arrays import FloatArray

MAX_MORE_DRIVING = 100.0
"""Largest factor on the duration of driving that is stated. Convention: nobody drives longer."""
_FACTORS = np.geomspace(1.0, MAX_MORE_DRIVING, 200)
_GAINS = np.geomspace(1.0, 1e8, 400)
"""Gains among which the least sufficient one is sought."""


@dataclass(frozen=True)
class Reach:
    """
    What limits the detection of an effect, by fitted variable.

    `curvature`: standard deviation by the loss alone, `deviation`: over blocks of time;
    `critical`: deviations that a significant effect exceeds.
    """

    curvature: list[float]
    deviation: list[float]
    critical: list[float]

    @classmethod
    def of(cls, likelihood: Likelihood, h: Hypothesis, examined: int) -> Reach:
        """Return the reach of the last effect of a fitted hypothesis."""
        assert h.fit is not None
        scores, part = BlockScores.of(likelihood, h), effect_variables(h)[-1]
        tests = examined * (part.stop - part.start)
        return cls(
            [float(x) for x in h.fit.deviation()[part]],
            [float(x) for x in scores.deviations()[part]],
            [
                least_significant(scores.active_blocks(j), scores.losses.size, tests)
                for j in range(part.start, part.stop)
            ],
        )

    def significance(self, active: ActiveEffect) -> float:
        """Return the largest size over the least significant one, over the variables."""
        return max(
            abs(theta - p.theta_neutral) / max(sigma * critical, 1e-30)
            for p, theta, sigma, critical in zip(
                active.effect.parameters, active.theta, self.deviation, self.critical, strict=True
            )
        )

    def detectable(self, active: ActiveEffect, loss: float) -> dict[str, float | None]:
        """Return the least size that removes `loss`, is significant and material."""
        sizes: dict[str, float | None] = {}
        for i, (parameter, theta) in enumerate(
            zip(active.effect.parameters, active.theta, strict=True)
        ):
            least = self.curvature[i] * float(np.sqrt(max(loss, 0.0)))
            least = max(least, self.critical[i] * self.deviation[i])
            # A parameter at its bound has no deviation.
            known = least > 0.0
            if not parameter.inverse:
                least = max(least, parameter.materiality_threshold)
            x = parameter.theta_neutral + (-least if theta < parameter.theta_neutral else least)
            low, high = parameter.bounds()
            known = known and low <= x <= high
            sizes[parameter.name] = parameter.value(x) if known else None
        return sizes


def sufficient_loss(h: Hypothesis, path: SelectionPath, penalty: float) -> float:
    """Return the loss that the last effect of `h`, next to the others, must remove for a claim."""
    effect = h.effects[-1].effect
    for removed in _GAINS:
        without = _without_last(h, float(removed))
        if removed - penalty > required_gain_of(effect, without, path):
            return float(removed)
    return np.inf


def _without_last(h: Hypothesis, removed: float) -> Hypothesis:
    """Return `h` without its last effect, which removes so much, if possible in its direction."""
    losses, direction = h.losses_by_direction, only_direction(h.effects[-1].effect)
    if losses is not None and direction is not None:
        losses = losses + removed * (np.arange(losses.size) == direction)
    return replace(h, effects=h.effects[:-1], loss=h.loss + removed, losses_by_direction=losses)


def more_driving(
    effect: Effect,
    before: Hypothesis,
    path: SelectionPath,
    removed: float,
    penalty: float,
    significance: float,
) -> float | None:
    """Return the least factor on the duration with which the fitted size would be claimed."""

    def longer(values: FloatArray | None, k: float) -> FloatArray | None:
        return None if values is None else k * values

    for k in _FACTORS:
        scaled = replace(
            path,
            expected_loss=k * path.expected_loss,
            expected_by_direction=longer(path.expected_by_direction, k),
            noise_loss_variance=k * path.noise_loss_variance,
            null_excess_loss=k * path.null_excess_loss,
            null_excess_by_direction=longer(path.null_excess_by_direction, k),
            surrogate_error_dof=k * path.surrogate_error_dof,
        )
        start = replace(
            before,
            loss=k * before.loss,
            losses_by_direction=longer(before.losses_by_direction, k),
        )
        required = required_gain_of(effect, start, scaled)
        # A standard deviation falls with the square root of the duration.
        if k * removed - penalty > required and significance * np.sqrt(k) > 1.0:
            return float(k)
    return None
