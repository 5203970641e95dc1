# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Since when a change in time acts: the interval of its change point.

At each other change point the sizes of all claims are fitted again, with the variance components
of the claims as they are. The interval holds the days at which twice the log-likelihood is less
than a quantile below that of the claim (profile likelihood). For a ramp, whose likelihood is
smooth, the quantile is that of chi-square with one degree of freedom (Wilks). The change point of
a step is not regular: of small steps over many recordings twice the log-likelihood ratio is at
most x with probability (1 - exp(-x / 2))^2 (B. E. Hansen, Econometrica 68, 2000, p. 575); of
large ones over few recordings it is less. A step may begin at any time between two recordings, so
that its interval ends at some.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.optimize import bisect

from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import FleetModel
from adk_ros.fleet.inference.levels import STEP
from adk_ros.fleet.inference.mixed_model import Term
from adk_ros.numerics.constants import QUANTILE_90

_EXAMINED = 40
"""
Most days at which the likelihood is computed first, among those of recordings, as in the fit of
the change point. By choice.
"""
STEP_QUANTILE_90 = -2.0 * math.log(1.0 - math.sqrt(0.9))
"""90 % quantile of twice the log-likelihood ratio of the change point of a step: 5.94."""
_RESOLUTION_DAY = 0.01
"""Accuracy of the ends of an interval, days: a quarter of an hour. By choice."""


def onset_interval(fleet: FleetEvidence, model: FleetModel, number: int) -> tuple[float, float]:
    """
    Return the 90 % interval of the change point, days, of the claim `number` of a model, a trend.

    It ends at the first and the last recording of the cars that the trend is about, at the latest.
    """
    claim, terms = model.claimed[number], model.terms()
    mixed, components = model.mixed(fleet), model.components_of(model.active())

    @cache
    def likelihood(day: float) -> float:
        level = replace(claim.level, onset=day)
        terms[number] = Term(claim.effect, level.design(fleet))
        return mixed.estimate(terms, components).likelihood

    quantile = STEP_QUANTILE_90 if claim.level.kind == STEP else QUANTILE_90**2
    least = likelihood(claim.level.onset) - 0.5 * quantile

    def end(day: float, beyond: float) -> float:
        """Return where the likelihood passes its least value, between a day inside and outside."""
        low, high = min(day, beyond), max(day, beyond)
        return float(bisect(lambda x: likelihood(x) - least, low, high, xtol=_RESOLUTION_DAY))

    car = claim.level.car
    days = np.unique(fleet.days[[not car or name == car for name in fleet.cars]])
    if days.size > _EXAMINED:
        days = np.asarray(np.quantile(days, np.linspace(0.0, 1.0, _EXAMINED)), dtype=np.float64)
    examined: list[float] = np.unique([*days, claim.level.onset]).tolist()
    inside = [i for i, day in enumerate(examined) if likelihood(day) >= least]
    first, last = inside[0], inside[-1]
    low = examined[0] if first == 0 else end(examined[first], examined[first - 1])
    is_latest = last + 1 == len(examined)
    return low, examined[-1] if is_latest else end(examined[last], examined[last + 1])
