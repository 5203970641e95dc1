# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Numerical fleets: evidence drawn from the quadratic model, without any simulation.

The information of a recording is that of random smooth residual columns, some of which resemble
each other as those of vehicle effects do. Scores are drawn with the tolerances and offsets of each
car, the deviations of cars and recordings, the surrogate's error, and the injected terms. False
alarms, coverage and power of the combination follow from many such fleets in minutes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.fleet.inference.evidence import Columns, effect_columns
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.levels import Level
from adk_ros.mismatch.library.criteria import SYSTEMATIC_ERROR_PER_MATERIALITY
from adk_ros.numerics.arrays import FloatArray

_RANK_ROWS = 150
"""Effectively independent residual combinations of a recording that the columns span."""
_SIMILARITY = 0.8
"""Correlation of an effect's column with that of the effect before it, for half of them."""
_EXPECTED_LOSS = 17_000.0
"""Loss of a perfect model of a recording: about that of 150 s with an IMU."""
_NUISANCE_INFORMATION = 4.0
"""Information on a tolerance or an offset in units of its prior's: half a deviation is seen."""


@dataclass(frozen=True)
class Injection:
    """A parameter (key effect.parameter) of a size, in materiality thresholds, at a level."""

    key: str
    level: Level
    size: float


@dataclass(frozen=True)
class FleetPlan:
    """
    What to draw: `cars` and `recordings`, and the deviation of one recording's estimate.

    `deviation`: of an effect's size from one recording with all else known, in materiality
    thresholds; `tau` and `kappa`: deviations of recordings and cars of every effect; `bias`:
    share of the surrogate's error in the score of the simulation, as a variance; `value_share`:
    share of recordings with the second value of the tag `software`.
    """

    cars: int = 6
    recordings: int = 30
    effects: int = 20
    deviation: float = 1.0
    tau: float = 0.0
    kappa: float = 0.0
    bias: float = 0.3
    weak: int = 2
    value_share: float = 0.3
    injections: tuple[Injection, ...] = ()


def draw_fleet(seed: int, plan: FleetPlan) -> FleetEvidence:
    """Return the evidence of a fleet; the same arguments give the same fleet."""
    rng = np.random.default_rng([seed, 18])
    keys = tuple(c.key for c in effect_columns())[: plan.effects]
    columns = Columns(plan.weak, keys)
    d, first, r = columns.size, columns.first_effect, plan.recordings
    cars = tuple(f"car{1 + i % plan.cars:02d}" for i in range(r))
    days = np.linspace(0.0, 60.0, r)
    software = np.where(rng.permutation(r) < plan.value_share * r, "2.1", "2.0")
    tags = tuple({"software": str(value)} for value in software)
    base = _columns_of(rng, d, first, plan.deviation)
    informations = np.array([_information(rng, base) for _ in range(r)])
    shares = np.ones(r)
    bias = plan.bias * _information(rng, base)
    zeros = np.zeros((r, d))
    fleet = FleetEvidence(
        columns,
        tuple(f"drive{i:03d}" for i in range(r)),
        zeros,
        informations,
        cars,
        days,
        tags,
        shares,
        bias,
        30,
        np.zeros(r),
        np.full(r, _EXPECTED_LOSS),
    )
    x = _joint_vectors(rng, fleet, plan)
    root = np.linalg.cholesky(bias + 1e-12 * np.eye(d)) if plan.bias else np.zeros((d, d))
    # The bias of the fleet's score is a draw with the covariance that the simulation shows.
    persistent = root @ rng.standard_normal(d)
    scores = np.empty((r, d))
    for i, h in enumerate(informations):
        noise = np.linalg.cholesky(h + 1e-12 * np.eye(d)) @ rng.standard_normal(d)
        scores[i] = h @ x[i] + noise + shares[i] * persistent
    # A perfect model is the truth: what its quadratic gains is what its absence costs.
    quadratic = np.einsum("ri,rij,rj->r", x, informations, x)
    excess = 2.0 * (scores * x).sum(axis=1) - quadratic
    return replace(fleet, scores=scores, excess=excess)


def _columns_of(rng: np.random.Generator, d: int, first: int, deviation: float) -> FloatArray:
    """Return residual columns (rows, d) whose squares sum up to the information on each."""
    base = rng.standard_normal((_RANK_ROWS, d))
    for j in range(first + 1, d, 2):
        base[:, j] = _SIMILARITY * base[:, j - 1] + np.sqrt(1 - _SIMILARITY**2) * base[:, j]
    base /= np.sqrt((base**2).sum(axis=0))
    size = np.full(d, np.sqrt(_NUISANCE_INFORMATION))
    size[first:] = 1.0 / deviation
    return np.asarray(base * size)


def _information(rng: np.random.Generator, base: FloatArray) -> FloatArray:
    """Return the information of a recording: rows of the columns weighted by its driving."""
    weight = np.sqrt(rng.gamma(2.0, 0.5, base.shape[0]))
    rows = base * weight[:, None]
    return np.asarray(rows.T @ rows)


def _joint_vectors(rng: np.random.Generator, fleet: FleetEvidence, plan: FleetPlan) -> FloatArray:
    """Return the joint vector (r, d) of each recording."""
    c, r = fleet.columns, len(fleet.names)
    names = fleet.car_names
    of_car = np.array([names.index(car) for car in fleet.cars])
    p = len(c.effects)
    x = np.zeros((r, c.size))
    tolerances = rng.standard_normal((len(names), c.tolerances.stop))
    offsets = rng.standard_normal((len(names), c.offsets.stop - c.offsets.start))
    x[:, c.tolerances] = tolerances[of_car]
    x[:, c.offsets] = offsets[of_car] + rng.standard_normal((r, offsets.shape[1]))
    x[:, c.weak_directions] = rng.standard_normal(plan.weak)
    effects = plan.kappa * rng.standard_normal((len(names), p))[of_car]
    effects += plan.tau * rng.standard_normal((r, p))
    effects += SYSTEMATIC_ERROR_PER_MATERIALITY * rng.standard_normal(p)
    for injection in plan.injections:
        effects[:, c.effects.index(injection.key)] += injection.size * injection.level.design(
            fleet
        )
    x[:, c.first_effect :] = effects
    return x


def with_injections(plan: FleetPlan, injections: Sequence[Injection]) -> FleetPlan:
    """Return a plan with injections."""
    return FleetPlan(**{**plan.__dict__, "injections": tuple(injections)})
