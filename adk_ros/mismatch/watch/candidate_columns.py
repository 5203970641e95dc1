# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Columns of a linearised block: nuisance parameters, then effect parameters.

Derivatives of effects are secants (see `inference.score_test`), one for each start value of an
effect whose residuals are far from linear in it. An effect's column has the unit of its
parameter's materiality threshold.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import TIME, Effect, EffectParameter
from adk_ros.mismatch.watch.settings import STATIC_SIGMA
from adk_ros.numerics.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class EffectColumn:
    """A secant: the effect at `theta`, and the factor that scales the change to its unit."""

    active: ActiveEffect
    scale: float


@dataclass(frozen=True)
class CandidateChange:
    """
    An effect that may set in, and its columns; `one_sided`: only positive sizes are possible.

    `start` (k,): fitted variables at which the secants were taken.
    """

    effect: Effect
    columns: IntArray
    start: tuple[float, ...]
    one_sided: bool


@dataclass(frozen=True)
class ColumnLayout:
    """
    All columns of a block, the residuals excepted.

    The first `n_nuisances` are those of the likelihood; `effects` follow. `static` (s,): columns
    that describe the car before a change, with the inverse prior variances `precision` (s,).
    """

    n_nuisances: int
    effects: tuple[EffectColumn, ...]
    candidates: tuple[CandidateChange, ...]
    static: IntArray
    precision: FloatArray

    @property
    def count(self) -> int:
        """Number of columns."""
        return self.n_nuisances + len(self.effects)

    @classmethod
    def of(
        cls,
        nuisance_deviations: FloatArray,
        unobservable: frozenset[str] = frozenset(),
        effects: Mapping[str, Effect] = EFFECTS,
    ) -> ColumnLayout:
        """Return the columns of all effects of a catalogue that may act from a time on."""
        n = nuisance_deviations.shape[0]
        columns: list[EffectColumn] = []
        candidates: list[CandidateChange] = []
        static: list[int] = list(range(n))
        for effect in effects.values():
            if TIME not in effect.activations or effect.name in unobservable:
                continue
            further = []
            for j, parameter in list(enumerate(effect.parameters))[1:]:
                further.append(n + len(columns))
                columns.append(_column(effect, j, parameter.theta_neutral + parameter.step))
            first = effect.parameters[0]
            starts = [first.theta(start) for start in first.starts]
            for i, start in enumerate(starts or [first.theta_neutral + first.step]):
                index = n + len(columns)
                columns.append(_column(effect, 0, start))
                if i == 0:
                    static += [index, *further]
                neutral = [p.theta_neutral for p in effect.parameters[1:]]
                candidates.append(
                    CandidateChange(
                        effect, np.array([index, *further]), (start, *neutral), bool(starts)
                    )
                )
        precision = np.full(len(static), STATIC_SIGMA**-2)
        precision[:n] = nuisance_deviations**-2.0
        return cls(n, tuple(columns), tuple(candidates), np.array(static), precision)


def unit_of(parameter: EffectParameter) -> float:
    """Return the change of the fitted variable at the materiality threshold."""
    threshold = parameter.materiality_threshold
    return 1.0 / threshold if parameter.inverse else threshold


def _column(effect: Effect, which: int, value: float) -> EffectColumn:
    theta = [p.theta_neutral for p in effect.parameters]
    parameter = effect.parameters[which]
    change = value - parameter.theta_neutral
    theta[which] = value
    return EffectColumn(ActiveEffect(effect, tuple(theta)), unit_of(parameter) / abs(change))
