# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recording's likelihood linearised in all nuisance parameters and all effects at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from adk_ros.fleet.inference.evidence import Column, Columns
from adk_ros.mismatch.inference.block_scores import block_of_rows
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis, inactive_effect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.surrogate.activation import ALWAYS_ACTIVE, Activation
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.numerics.levenberg_marquardt import huber_root, huber_values

_PRIOR_UNITS = 100.0
"""
Prior standard deviation of an effect in a recording's own fit, in materiality thresholds: wide,
since the fit only centres the scores of the blocks.
"""


@dataclass(frozen=True)
class Linearisation:
    """
    Residuals e (m,) of a likelihood at a point, and their derivatives.

    `residuals` (m,) and `jacobian` (m, d), both times the root of Huber's weights, with respect to
    the scaled joint vector; `point` (d,): where, in those units; `loss`: Huber's.
    """

    residuals: FloatArray
    jacobian: FloatArray
    point: FloatArray
    block: IntArray
    loss: float
    unweighted: FloatArray
    """(m,) the residuals without Huber's weights."""

    @cached_property
    def information(self) -> FloatArray:
        """The information H = J^T W J (d, d)."""
        return np.asarray(self.jacobian.T @ self.jacobian)

    @cached_property
    def score(self) -> FloatArray:
        """The score (d,) in absolute coordinates: -J^T W e + H x0."""
        return np.asarray(
            -self.jacobian.T @ self.residuals + self.jacobian.T @ (self.jacobian @ self.point)
        )

    def of_rows(self, kept: BoolArray) -> Linearisation:
        """Return the linearisation with some rows (m,) alone; the others count as missing."""
        return replace(
            self,
            residuals=np.where(kept, self.residuals, 0.0),
            jacobian=np.where(kept[:, None], self.jacobian, 0.0),
            loss=float(huber_values(self.unweighted[kept]).sum()),
            unweighted=np.where(kept, self.unweighted, 0.0),
        )

    def block_scores(self, at: FloatArray) -> FloatArray:
        """Return the score (b, d) of each block with data, at a point (d,) of the linear model."""
        e = self.residuals + self.jacobian @ (at - self.point)
        used = self.residuals != 0.0
        return np.array(
            [
                -self.jacobian[rows].T @ e[rows]
                for i in np.unique(self.block[used])
                for rows in [(self.block == i) & used]
            ]
        )


def theta_of(column: Column, values: Mapping[str, float]) -> float:
    """Return the fitted variable of a column at values, key -> difference from neutral."""
    return column.parameter.theta_neutral + values.get(column.key, 0.0)


def effects_at(
    columns: Sequence[Column], values: Mapping[str, float], activation: Activation = ALWAYS_ACTIVE
) -> list[ActiveEffect]:
    """Return the effects with any value, at their values; all parameters of one together."""
    found: dict[str, ActiveEffect] = {}
    for column in columns:
        if column.key in values:
            effect = column.effect
            active = found.get(effect.name, inactive_effect(effect, activation))
            i = effect.parameters.index(column.parameter)
            theta = list(active.theta)
            theta[i] = theta_of(column, values)
            found[effect.name] = ActiveEffect(effect, tuple(theta), activation)
    return list(found.values())


def difference_step(column: Column, value: float, is_local: bool = False) -> float:
    """
    Return the difference step of a column's derivative at a value (difference from neutral).

    At neutral, effects that only act in one direction or from a threshold on (delays, friction)
    are far from linear: their derivative is the secant to the first start value of a fit.
    """
    p = column.parameter
    if value == 0.0 and p.starts and not is_local:
        return p.theta(p.starts[0]) - p.theta_neutral
    _, high = p.bounds()
    theta = p.theta_neutral + value
    return p.step if theta + p.step <= high else -p.step


def effect_column(
    likelihood: Likelihood,
    base: FloatArray,
    columns: Sequence[Column],
    column: Column,
    values: Mapping[str, float],
    placed: Sequence[ActiveEffect] = (),
    is_local: bool = False,
) -> FloatArray:
    """
    Return the derivative (m,) of the whitened residuals by a column, in scaled units.

    `base` (m,): the residuals at `values`, with the effects `placed` that act at places.
    `is_local`: with the small step also at neutral, for an effect that acts at places already.
    """
    step = difference_step(column, values.get(column.key, 0.0), is_local)
    moved = {**values, column.key: values.get(column.key, 0.0) + step}
    zero = np.zeros(likelihood.n_nuisances)
    every = columns if column in columns else [*columns, column]
    changed = likelihood.residuals(zero, [*effects_at(every, moved), *placed])
    return np.asarray((changed - base) / step * column.materiality)


def linearised(
    likelihood: Likelihood,
    layout: Columns,
    columns: Sequence[Column],
    values: Mapping[str, float] | None = None,
    residuals: FloatArray | None = None,
    placed: Sequence[ActiveEffect] = (),
) -> Linearisation:
    """
    Linearise a likelihood at the values of effects (key -> difference from neutral), nuisances 0.

    `residuals` (m,) replace the likelihood's: whitened, of the same rows. `placed`: effects at
    places that act as well. Effects that the recording's channels do not show have a derivative of
    zero.
    """
    values = {k: v for k, v in (values or {}).items() if v != 0.0}
    zero = np.zeros(likelihood.n_nuisances)
    effects = [*effects_at(columns, values), *placed]
    base = likelihood.residuals(zero, effects)
    hypothesis = Hypothesis(tuple(effects), zero, 0.0)
    scale = layout.scale
    jacobian = np.zeros((base.shape[0], layout.size))
    first = layout.first_effect
    jacobian[:, :first] = likelihood.nuisance_jacobian(hypothesis) * scale[:first]
    for i, column in enumerate(columns):
        if column.effect.name not in likelihood.unobservable:
            jacobian[:, first + i] = effect_column(
                likelihood, base, columns, column, values, placed
            )
    e = base if residuals is None else residuals
    root = huber_root(e)
    point = np.zeros(layout.size)
    for i, column in enumerate(columns):
        point[first + i] = values.get(column.key, 0.0) / column.materiality
    jacobian *= root[:, None]
    jacobian[e == 0.0] = 0.0
    return Linearisation(
        e * root,
        jacobian,
        point,
        block_of_rows(likelihood, e.shape[0]),
        float(huber_values(e).sum()),
        e,
    )


def dispersion(linear: Linearisation, columns: Columns) -> float:
    """
    Return the variance of the scores between blocks over that of white noise, at least one.

    The scores are centred by the recording's own fit. The median over the joint vector's entries.
    """
    information = linear.information
    prior = np.ones(columns.size)
    prior[columns.first_effect :] = 1.0 / _PRIOR_UNITS**2
    at = np.linalg.solve(information + np.diag(prior), linear.score)
    scores = linear.block_scores(np.asarray(at))
    expected: FloatArray = np.diag(information)
    used = expected > 0.0
    if scores.shape[0] < 2 or not used.any():
        return 1.0
    ratio = (scores[:, used] ** 2).sum(axis=0) / expected[used]
    return float(max(np.median(ratio), 1.0))
