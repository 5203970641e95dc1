# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Variance components of a fleet, and the degrees of freedom of a size.

The deviations tau (between recordings) and kappa (between cars) of an effect maximise the
restricted likelihood times tau kappa. The factor keeps both from zero, where chance puts the
maximum in half of all fleets that have no deviation, and intervals would be too short (Y. Chung,
S. Rabe-Hesketh, V. Dorie, A. Gelman, J. Liu, "A nondegenerate penalized likelihood estimator for
variance parameters in multilevel models", Psychometrika 78 (2013) 685). Where a component is well
determined, it changes nothing.

The variance of a size is a sum of parts: noise and build tolerances, which are known, the
deviations of recordings and of cars, and the surrogate's error, which are estimated. Its degrees
of freedom follow from Satterthwaite's formula (F. E. Satterthwaite, "An approximate distribution
of estimates of variance components", Biometrics Bulletin 2 (1946) 110). Where hardly any car has a
second recording, tau and kappa enter as tau^2 + kappa^2 only: how the fit divides this sum between
them is arbitrary, and the sum has the degrees of freedom of all recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from adk_ros.fleet.inference.mixed_model import Components, Estimate, MixedModel, Term
from adk_ros.fleet.inference.shared_error import FLEETS
from adk_ros.mismatch.library.criteria import (
    SYSTEMATIC_ERROR_PER_MATERIALITY,
    SYSTEMATIC_ERROR_SHARE,
)
from adk_ros.numerics.arrays import BoolArray, FloatArray

_LOWEST, _HIGHEST, _START = 1e-3, 1e3, 0.1
"""Range and start of a deviation in units of the materiality threshold."""
_ROUNDS = 2
"""Passes over the active effects, whose components hardly depend on each other."""
_TOLERANCE = 0.1
"""Of the log-likelihood and of log(deviation): far below what a fleet determines of them."""
_FEW_REPEATED = 0.1
"""
Share of recordings beyond the first of their car up to which tau and kappa count as one: the cars
have then about nine tenths of the degrees of freedom of the recordings. By choice.
"""
_SIMPLEX = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
"""First simplex of log(deviation), from the start."""


def start_components(count: int) -> Components:
    """Return the components of `count` effects to start from."""
    return Components(np.full(count, _START), np.full(count, _START))


def fitted_components(
    model: MixedModel,
    terms: Sequence[Term],
    start: Components,
    which: Sequence[int] | None = None,
) -> Components:
    """Fit the components of the active effects `which` (all of them: None), one after another."""
    found = Components(start.tau.copy(), start.kappa.copy())
    chosen = range(len(model.active)) if which is None else which
    for _ in range(_ROUNDS if len(chosen) > 1 else 1):
        for i in chosen:
            found = _fitted_one(model, terms, found, i)
    return found


def _fitted_one(model: MixedModel, terms: Sequence[Term], start: Components, i: int) -> Components:
    has_cars = len(model.fleet.car_names) > 1
    profile = model.profile(terms, start, i)
    low, high = np.log(_LOWEST), np.log(_HIGHEST)

    def deviations(x: FloatArray) -> tuple[float, float]:
        tau, kappa = np.exp(np.clip(x, low, high))
        return float(tau), float(kappa) if has_cars else 0.0

    def cost(x: FloatArray) -> float:
        return -(profile.restricted(*deviations(x)) + float(np.clip(x, low, high).sum()))

    x0 = np.log(np.clip([start.tau[i], start.kappa[i]], _LOWEST, _HIGHEST))
    found = minimize(
        cost,
        x0,
        method="Nelder-Mead",
        options={"initial_simplex": x0 + _SIMPLEX, "xatol": _TOLERANCE, "fatol": _TOLERANCE},
    )
    tau, kappa = start.tau.copy(), start.kappa.copy()
    tau[i], kappa[i] = deviations(found.x)
    return Components(tau, kappa)


def total_variance(model: MixedModel, terms: Sequence[Term], estimate: Estimate, m: int) -> float:
    """
    Return the variance of the size of term `m`: model, surrogate's error, inexact equation.

    The last is that of a single recording (`criteria.SYSTEMATIC_ERROR_*`): it repeats. Of an
    effect of all cars, the surrogate's error is also that on other roads
    (`FleetEvidence.systematic_deviation`).
    """
    inexact = (SYSTEMATIC_ERROR_SHARE * float(estimate.sizes[m])) ** 2
    inexact += _systematic(model, terms[m]) ** 2
    return float(estimate.covariance[m, m] + estimate.bias[m, m]) + inexact


def _systematic(model: MixedModel, term: Term) -> float:
    """Return the systematic deviation of a term's size, in materiality thresholds."""
    if not (term.design == 1.0).all():
        return SYSTEMATIC_ERROR_PER_MATERIALITY
    return model.fleet.systematic_deviation(term.effect)


def degrees_of_freedom(
    model: MixedModel,
    terms: Sequence[Term],
    components: Components,
    m: int,
    sample: BoolArray | None = None,
) -> float:
    """
    Return the degrees of freedom of the variance of the size of term `m`.

    `sample` (r,): recordings that the components were fitted to, by default all.
    """
    i = model.active.index(terms[m].effect)
    zero = components.tau.copy()
    zero[i] = 0.0
    without_cars = components.kappa.copy()
    without_cars[i] = 0.0
    estimate = model.estimate(terms, components, with_bias=True)
    full = float(estimate.covariance[m, m])
    part = float(model.estimate(terms, replace(components, kappa=without_cars)).covariance[m, m])
    known = float(model.estimate(terms, Components(zero, without_cars)).covariance[m, m])
    counted = ~model.free[:, i] & (True if sample is None else sample)
    cars = len({car for car, c in zip(model.fleet.cars, counted, strict=True) if c})
    recordings = int(np.count_nonzero(counted))
    of_effect = sum(
        term.effect == terms[m].effect and bool(term.design[counted].any()) for term in terms
    )
    bias = float(estimate.bias[m, m])
    if _are_one(model, terms[m], counted):
        spread = max(full - known, 0.0) ** 2 / max(recordings - of_effect, 1)
    else:
        of_cars = max(cars - of_effect, 1)
        of_recordings = max(recordings - cars - of_effect, 1)
        spread = (full - part) ** 2 / of_cars + max(part - known, 0.0) ** 2 / of_recordings
    spread += bias**2 / max(model.fleet.bias_blocks - 1, 1)
    spread += _systematic(model, terms[m]) ** 4 / (FLEETS - 1)
    variance = total_variance(model, terms, estimate, m)
    return max(variance**2 / max(spread, 1e-300), 1.0)


def _are_one(model: MixedModel, term: Term, counted: BoolArray) -> bool:
    """
    Whether hardly any car has a second recording, in the fleet and where a term acts.

    Of the recordings (r,) that are `counted`: those that tau and kappa come from.
    """
    every = [car for car, c in zip(model.fleet.cars, counted, strict=True) if c]
    acting = [
        car
        for car, z, c in zip(model.fleet.cars, term.design, counted, strict=True)
        if c and z != 0.0
    ]
    return all(len(c) - len(set(c)) <= _FEW_REPEATED * len(c) for c in (every, acting))
