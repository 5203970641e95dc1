# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The hypotheses of a selection, and what a further effect must gain to be accepted.

A hypothesis costs its loss plus `PENALTY_PER_PARAMETER` for each fitted variable and
`PENALTY_PER_LOCATION` for each onset or segment boundary. A further effect must lower that cost by
at least

- `MIN_GAIN`, the first one `MIN_FIRST_GAIN`,
- `MIN_GAIN_PER_EXCESS` of the excess loss before it, above what chance causes,
- `MIN_GAIN_PER_NULL_EXCESS` of the excess loss before any effect, both of all channels, or of the
  longitudinal or the lateral ones where no effect before it acts in that direction,
- `MIN_GAIN_PER_SURROGATE_ERROR` of the surrogate error, the first one
  `MIN_FIRST_GAIN_PER_SURROGATE_ERROR`, and a further one
  `MIN_FURTHER_GAIN_PER_SURROGATE_ERROR` where those before leave no more than a perfect model.

`library.criteria` gives their reasons.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.result import SelectionStep
from adk_ros.mismatch.inference.segments import SpatialProfile
from adk_ros.mismatch.library.criteria import (
    MIN_FIRST_GAIN,
    MIN_FIRST_GAIN_PER_SURROGATE_ERROR,
    MIN_FURTHER_GAIN_PER_SURROGATE_ERROR,
    MIN_GAIN,
    MIN_GAIN_PER_EXCESS,
    MIN_GAIN_PER_NULL_EXCESS,
    MIN_GAIN_PER_SURROGATE_ERROR,
    PENALTY_PER_LOCATION,
    PENALTY_PER_PARAMETER,
)
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.library.sensitivity import decided
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import QUANTILE_90

_EQUATIONS = (frozenset({"v_x"}), frozenset({"v_y", "yaw_rate"}))
"""Of the longitudinal and of the lateral direction."""


@dataclass
class SelectionPath:
    """
    The hypotheses of a selection.

    `levels` are hypotheses of increasing size, best first; those of one cause may follow without
    smaller ones; `profiles` the effects' sizes along the
    lap as they were estimated.
    """

    levels: list[list[Hypothesis]] = field(default_factory=list)
    profiles: list[SpatialProfile] = field(default_factory=list)
    expected_loss: float = 0.0
    """Loss of a perfect model."""
    expected_by_direction: FloatArray | None = None
    """The same (2,) of the longitudinal and of the lateral channels."""
    noise_loss_variance: float = 0.0
    """Variance that the error of the estimated noise adds to it."""
    null_excess_loss: float = 0.0
    """Excess loss before any effect."""
    null_excess_by_direction: FloatArray | None = None
    """The same (2,) of the longitudinal and of the lateral channels."""
    surrogate_error_dof: float = 0.0
    """Number of residuals that the surrogate's own error accounts for."""
    examined: int = 0
    """Number of effects, places and onsets among which the first effect was chosen."""
    immaterial: list[Hypothesis] = field(default_factory=list)
    """Fitted hypotheses of one effect that is below its materiality threshold."""
    of_one_cause: list[Hypothesis] = field(default_factory=list)
    """Hypotheses of effects that one change of the car has together, as screened."""

    def best(self, most: int | None = None) -> Hypothesis:
        """Return the largest hypothesis, of at most `most` effects, each of which is accepted."""
        chosen = self.levels[0][0]
        for level in self.levels[1:]:
            within = [h for h in level if most is None or len(h.effects) <= most]
            chosen = self.first_accepted(within, chosen) or chosen
        return chosen

    def first_accepted(self, level: Sequence[Hypothesis], chosen: Hypothesis) -> Hypothesis | None:
        """
        Return the best hypothesis of a level that is accepted, none if none is.

        Not always the one with the least loss: what gains in a direction in which none of `chosen`
        acts need gain less.
        """
        return next((h for h in level if self.accepts(h, chosen)), None)

    def singles(self) -> list[Hypothesis]:
        """Return the fitted hypotheses of one effect, best first."""
        return [h for level in self.levels[1:] for h in level if len(h.effects) == 1]

    def accepts(self, h: Hypothesis, chosen: Hypothesis) -> bool:
        """Whether `h` gains enough over `chosen`, and over each fitted part of it."""
        names = set(h.names)
        parts = [x for level in self.levels[1:] for x in level if set(x.names) < names]
        return all(is_improvement(h, before, self) for before in (chosen, *parts))


def selection_steps(path: SelectionPath) -> list[SelectionStep]:
    """
    Return the best accepted hypothesis of each size, and what it gained over the one before.

    Of a size of which none is accepted, the best one.
    """
    before = path.levels[0][0]
    steps = [SelectionStep((), before.loss)]
    for level in path.levels[1:]:
        accepted = path.first_accepted(level, before)
        best = accepted or level[0]
        steps.append(SelectionStep(best.names, best.loss, *gain_and_required(best, before, path)))
        before = accepted or before
    return steps


def penalised_loss(h: Hypothesis) -> float:
    """Return the loss with the penalty for fitted variables."""
    penalty = 0.0
    for active in h.effects:
        penalty += PENALTY_PER_PARAMETER * len(active.theta)
        penalty += PENALTY_PER_LOCATION * len(active.activation.variables())
    return h.loss + penalty


def gain_and_required(
    h: Hypothesis, before: Hypothesis, path: SelectionPath
) -> tuple[float, float]:
    """Return the penalised gain of `h` and what is required, as for `is_improvement`."""
    more = _more_effects(h, before)
    pairs = [(gain, more * required.least()) for gain, required in _gains(h, before, path)]
    return max(pairs, key=lambda pair: pair[0] / pair[1])


def is_improvement(h: Hypothesis, before: Hypothesis, path: SelectionPath) -> bool:
    """Whether `h` gains enough over `before`, which has fewer effects."""
    more = _more_effects(h, before)
    return any(
        [required.is_exceeded_by(gain / more) for gain, required in _gains(h, before, path)]
    )


def _more_effects(h: Hypothesis, before: Hypothesis) -> int:
    return max(len(h.effects) - len(before.effects), 1)


def min_required_gain(before: Hypothesis, path: SelectionPath) -> float:
    """
    Return the penalised gain, over all channels, that a further effect must bring.

    Effects whose loss is within the expected one leave nothing to explain: what a further effect
    gains there is rather the surrogate's error.
    """
    return _RequiredGain.of(before, path).least()


def required_gain_of(effect: Effect, before: Hypothesis, path: SelectionPath) -> float:
    """Return the least gain of an effect: in the free direction in which alone it acts, or all."""
    required = min_required_gain(before, path)
    direction = only_direction(effect)
    if direction in free_directions(before, path):
        required = min(required, _RequiredGain.of(before, path, direction).least())
    return required


def least_required_gain(before: Hypothesis, path: SelectionPath) -> float:
    """Return the gain below which a further effect is accepted in no direction."""
    directions = (None, *free_directions(before, path))
    return min(_RequiredGain.of(before, path, i).least() for i in directions)


def _gains(
    h: Hypothesis, before: Hypothesis, path: SelectionPath
) -> list[tuple[float, _RequiredGain]]:
    """
    Return the penalised gain with what is required: one of both has to be met.

    Over all channels; also over the longitudinal or the lateral ones where no effect of `before`
    acts: an inexact equation of a drive torque leaves nothing that a crosswind would fit, while
    that of a payload does.
    """
    gain = penalised_loss(before) - penalised_loss(h)
    out = [(gain, _RequiredGain.of(before, path))]
    start, after = before.losses_by_direction, h.losses_by_direction
    if start is not None and after is not None:
        penalty = (penalised_loss(h) - h.loss) - (penalised_loss(before) - before.loss)
        for i in free_directions(before, path):
            less = min(gain, float(start[i] - after[i]) - penalty)
            out.append((less, _RequiredGain.of(before, path, i)))
    return out


def free_directions(before: Hypothesis, path: SelectionPath) -> list[int]:
    """
    Return the directions, 0: longitudinal, 1: lateral, in which no effect of a hypothesis acts.

    Empty without effects, with one of the sensors, and where losses were not split.
    """
    if before.losses_by_direction is None or path.expected_by_direction is None:
        return []
    entered = {equation for active in before.effects for equation in active.effect.equations}
    if not entered or not entered <= {"v_x", "v_y", "yaw_rate"}:
        return []
    return [i for i, known in enumerate(_EQUATIONS) if not known & entered]


def only_direction(effect: Effect) -> int | None:
    """Return the direction in which alone an effect acts, None for more than one and sensors."""
    entered = set(effect.equations)
    alone = [i for i, known in enumerate(_EQUATIONS) if entered and entered <= known]
    return alone[0] if alone else None


@dataclass(frozen=True)
class _RequiredGain:
    """
    What a further effect must gain: over all channels, or in a free direction.

    `excess` and `null_excess` losses there, before it and before any effect; `surrogate_error`
    loss. `constants`: those that apply, by name.
    """

    excess: float
    null_excess: float
    surrogate_error: float
    constants: dict[str, float]

    @classmethod
    def of(
        cls, before: Hypothesis, path: SelectionPath, direction: int | None = None
    ) -> _RequiredGain:
        """Return what is required next to the effects of `before`."""
        loss, expected, null_excess = before.loss, path.expected_loss, path.null_excess_loss
        if direction is not None:
            assert before.losses_by_direction is not None
            assert path.expected_by_direction is not None
            assert path.null_excess_by_direction is not None
            loss = float(before.losses_by_direction[direction])
            expected = float(path.expected_by_direction[direction])
            null_excess = float(path.null_excess_by_direction[direction])
        # The loss of n Gaussian residuals is a chi-square: mean n, variance 2 n with known noise.
        # What the estimated noise adds is not known by direction: all of it counts.
        chance = QUANTILE_90 * math.sqrt(2.0 * expected + path.noise_loss_variance)
        constants = _constants(not before.effects, loss <= expected)
        return cls(
            max(loss - expected - chance, 0.0), null_excess, path.surrogate_error_dof, constants
        )

    def least(self) -> float:
        """Return the least gain."""
        return self._least(*self.constants.values())

    def is_exceeded_by(self, gain: float) -> bool:
        """Whether a gain suffices."""
        return bool(decided(lambda *values: gain > self._least(*values), **self.constants))

    def _least(self, least: float, share: float, per_excess: float, per_null: float) -> float:
        return max(
            least,
            share * self.surrogate_error,
            per_excess * self.excess,
            per_null * self.null_excess,
        )


def _constants(is_first: bool, is_explained: bool) -> dict[str, float]:
    """Return the constants that apply to a further effect, by name, in the order of use."""
    if is_first:
        constants = {
            "MIN_FIRST_GAIN": MIN_FIRST_GAIN,
            "MIN_FIRST_GAIN_PER_SURROGATE_ERROR": MIN_FIRST_GAIN_PER_SURROGATE_ERROR,
        }
    elif is_explained:
        constants = {
            "MIN_GAIN": MIN_GAIN,
            "MIN_FURTHER_GAIN_PER_SURROGATE_ERROR": MIN_FURTHER_GAIN_PER_SURROGATE_ERROR,
        }
    else:
        constants = {
            "MIN_GAIN": MIN_GAIN,
            "MIN_GAIN_PER_SURROGATE_ERROR": MIN_GAIN_PER_SURROGATE_ERROR,
        }
    return constants | {
        "MIN_GAIN_PER_EXCESS": MIN_GAIN_PER_EXCESS,
        "MIN_GAIN_PER_NULL_EXCESS": MIN_GAIN_PER_NULL_EXCESS,
    }
