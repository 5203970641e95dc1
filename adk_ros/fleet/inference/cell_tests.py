# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Tests of one parameter at the cells of the map, against what cells show where nothing acts.

At the fleet's estimate of all else, the evidence of recording r at a cell about a parameter is a
score s_r and an information h_r. The size of the cell is sum s / sum h; its variance is the larger
of 1 / sum h and that of the scatter between recordings (J. Hartung, G. Knapp, "On tests of the
overall treatment effect in meta-analysis with normally distributed responses", Statistics in
Medicine 20 (2001) 1771), with Student's t over the recordings.

The surrogate's error depends on the manoeuvre, so the same bend feigns the same effect every day.
How large such effects are is seen in all other cells (an empirical null; B. Efron, "Large-scale
simultaneous hypothesis testing", J. Am. Stat. Assoc. 99 (2004) 96). An error of the accelerations
feigns a size that is the larger, the less a cell informs about the parameter: it multiplies the
variance of noise. An error of the parameter itself adds the same variance in every cell. Both
follow from the robust deviations of the sizes from their median, the former in the half of the
cells with the least information, the latter in the other half. Neither shrinks with the number of
recordings.

Few manoeuvres feign much more than most: the errors have heavier tails than noise, so that many
recordings make the largest of them significant. The degrees of freedom of Student's t that fit the
other cells bound those of a test (`tail_of`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import stdtr
from scipy.stats import t as student

from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.levels import BOUND_DEVIATIONS, MIN_RECORDINGS
from adk_ros.mismatch.library.criteria import SYSTEMATIC_ERROR_PER_MATERIALITY
from adk_ros.numerics.arrays import FloatArray

AtCell = TypeVar("AtCell")

_MAD_TO_SIGMA = 1.4826
"""Standard deviation over median absolute deviation, of a Gaussian."""
_MIN_CELLS = 10
"""Least cells that determine the deviation of the surrogate's error between places."""
_CENSORED = 0.05
"""
Share of the largest deviations that count as at least that large, not by their size: other effects
may be among them. By choice.
"""
_FREEDOMS = (1.0, 200.0)
"""Range of the degrees of freedom of a tail, from that of Cauchy to a nearly normal one."""
_PRIOR_RATE = 0.1
"""Rate of the prior of a tail (`tail_of`)."""
_NULL_ROUNDS = 50
"""Rounds in which the two parts of that error are fitted in turn, until neither changes."""


@dataclass(frozen=True)
class CellTest:
    """Size of one parameter at one cell."""

    size: float
    variance: float
    freedom: float

    @property
    def gain(self) -> float:
        """Size squared over its variance: twice the logarithm of a likelihood ratio."""
        return self.size**2 / self.variance if self.variance > 0.0 else 0.0


@dataclass(frozen=True)
class Null:
    """Sizes of a parameter where nothing acts: median, variance, factor on that of noise."""

    centre: float
    spread: float
    inflation: float


def cell_test(scores: FloatArray, informations: FloatArray) -> CellTest:
    """Return the size of a parameter from the scores and informations (v,) of recordings."""
    total = float(informations.sum())
    count = int(np.count_nonzero(informations > 0.0))
    if count < MIN_RECORDINGS or total <= 0.0:
        return CellTest(0.0, 0.0, 1.0)
    size = float(scores.sum()) / total
    scatter = float(((scores - informations * size) ** 2).sum()) / total**2
    variance = max(1.0 / total, scatter * count / (count - 1.0))
    return CellTest(size, variance, count - 1.0)


def null_of(tests: Sequence[CellTest]) -> Null:
    """Return what a parameter's sizes over cells show of the surrogate's error."""
    used = [test for test in tests if test.variance > 0.0]
    if len(used) < _MIN_CELLS:
        return Null(0.0, 1.0, 1.0)
    sizes = np.array([test.size for test in used])
    variances = np.array([test.variance for test in used])
    centre = float(np.median(sizes))
    uncertain = variances > np.median(variances)
    inflation, spread = 1.0, 0.0
    for _ in range(_NULL_ROUNDS):
        # Squared robust deviation in units of the expected one: one, if the null is right.
        scaled = (sizes - centre)[uncertain] ** 2 / (variances[uncertain] + spread / inflation)
        inflation = max(_MAD_TO_SIGMA**2 * float(np.median(scaled)), 1.0)
        precise = _MAD_TO_SIGMA**2 * float(np.median((sizes - centre)[~uncertain] ** 2))
        spread = max(precise - inflation * float(np.median(variances[~uncertain])), 0.0)
    return Null(centre, spread, inflation)


def tail_of(tests: Sequence[CellTest]) -> float:
    """
    Return the likeliest degrees of freedom of Student's t of sizes where nothing acts.

    In units of their deviations, with the largest ones censored. A priori they follow Gamma(2,
    0.1), for which few sizes are no evidence of a normal distribution (M. A. Juárez, M. F. J.
    Steel, "Model-based clustering of non-Gaussian panel data based on skew-t distributions", J.
    Bus. Econ. Stat. 28 (2010) 52).
    """
    z = np.sort([abs(test.size) / np.sqrt(test.variance) for test in tests if test.variance > 0.0])
    largest = int(np.ceil(_CENSORED * len(z)))
    known = z[: len(z) - largest]
    limit = known[-1] if known.size else 0.0

    def cost(logarithm: float) -> float:
        freedom = np.exp(logarithm)
        density = student.logpdf(known, freedom).sum()
        prior = logarithm - _PRIOR_RATE * freedom
        return -float(density + largest * student.logsf(limit, freedom) + prior)

    low, high = np.log(_FREEDOMS)
    return float(np.exp(minimize_scalar(cost, bounds=(low, high), method="bounded").x))


def deviation_of(tests: Mapping[AtCell, CellTest], cells: Sequence[AtCell]) -> float:
    """
    Return the deviation of the size of a place.

    The surrogate's error repeats in adjoining cells: many say a size no better than one.
    """
    variance = min(tests[cell].variance for cell in cells)
    return float(np.sqrt(variance + SYSTEMATIC_ERROR_PER_MATERIALITY**2))


def together(tests: Mapping[AtCell, CellTest], cells: Sequence[AtCell]) -> CellTest:
    """
    Return the test of one size in all cells.

    Errors of adjoining cells may be the same: the relative deviations sqrt(2 / f) of their
    variances add, by the weight of each cell, to that of f degrees of freedom.
    """
    known = [tests[cell] for cell in cells if cell in tests]
    if not known:
        return CellTest(0.0, 0.0, 1.0)
    weights = np.array([1.0 / test.variance for test in known])
    size = float(weights @ np.array([test.size for test in known]) / weights.sum())
    freedoms = np.array([test.freedom for test in known])
    freedom = float((weights / weights.sum() / np.sqrt(freedoms)).sum() ** -2)
    return CellTest(size, float(1.0 / weights.sum()), freedom)


def p_value(test: CellTest) -> float:
    return 2.0 * float(stdtr(test.freedom, -abs(test.size) / np.sqrt(test.variance)))


def is_claimable(key: str, test: CellTest) -> bool:
    """Whether a size is material, and within the bounds of its parameter but for chance."""
    # Evidence at places is of full-size cars only.
    low, high = column_of(key).bounds
    slack = BOUND_DEVIATIONS * float(np.sqrt(test.variance))
    return abs(test.size) >= 1.0 and low - slack <= test.size <= high + slack
