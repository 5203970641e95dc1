# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The hierarchical model: equal to dense generalised least squares, and its own short cut."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import CAR, SHARED, Level
from adk_ros.fleet.inference.mixed_model import Components, MixedModel, Term
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, draw_fleet

PLAN = FleetPlan(cars=3, recordings=9, effects=5, weak=1, bias=0.4)
FRICTION = 4
"""Index of an effect that acts in one direction only."""


@pytest.mark.parametrize("second", [2, FRICTION])
def test_equals_dense_least_squares(second: int) -> None:
    fleet = replace(draw_fleet(3, PLAN), is_at_estimate=True)
    tau, kappa = np.array([0.4, 0.2]), np.array([0.7, 0.6])
    active = (1, second)
    assert column_of(fleet.columns.effects[FRICTION]).is_one_sided
    car = np.array([fleet.car_names.index(c) for c in fleet.cars])
    some = np.array([1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0])
    designs = [np.ones(9), some]
    one_car = (car == 1).astype(float)
    terms = [Term(1, designs[0]), Term(second, some), Term(second, one_car)]
    # What acts in one direction only deviates where it acts in several cars.
    acting = np.ones((9, 2))
    if second == FRICTION:
        acting[:, 1] = some
    found = MixedModel(fleet, active).estimate(terms, Components(tau, kappa), with_bias=True)

    # All variables at once: beta, weak directions, those of each car, those of each recording.
    c = fleet.columns
    first = c.first_effect
    m, per_car, per_recording = 3, 15 + 2, 3 + 2
    size = m + 1 + 3 * per_car + 9 * per_recording
    normal, right = np.zeros((size, size)), np.zeros(size)
    for r in range(9):
        p = np.zeros((c.size, size))
        own = m + 1 + car[r] * per_car
        single = m + 1 + 3 * per_car + r * per_recording
        p[:15, own : own + 15] = np.eye(15)
        p[12:15, single : single + 3] = np.eye(3)
        p[15, m] = 1.0
        for i, effect in enumerate(active):
            p[first + effect, own + 15 + i] = kappa[i] * acting[r, i]
            p[first + effect, single + 3 + i] = tau[i] * acting[r, i]
            p[first + effect, i] = designs[i][r]
        p[first + second, 2] = one_car[r]
        normal += p.T @ fleet.informations[r] @ p
        right += p.T @ fleet.scores[r]
    normal[m:, m:] += np.eye(size - m)
    inverse = np.linalg.inv(normal)
    np.testing.assert_allclose(found.sizes, (inverse @ right)[:m], rtol=1e-5)
    np.testing.assert_allclose(found.covariance, inverse[:m, :m], rtol=1e-5)
    # The gain of all variables against none is the constant of the likelihood.
    gain = 0.5 * right @ inverse @ right
    determinant = np.linalg.slogdet(normal[m:, m:])[1]
    np.testing.assert_allclose(found.likelihood, gain - 0.5 * determinant, rtol=1e-6)
    for i in range(2):
        np.testing.assert_allclose(
            found.car_deviations[:, i],
            [kappa[i] * (inverse @ right)[m + 1 + k * per_car + 15 + i] for k in range(3)],
            rtol=1e-4,
            atol=1e-8,
        )


def test_the_profile_is_the_restricted_likelihood() -> None:
    fleet = replace(draw_fleet(4, PLAN), is_at_estimate=True)
    model = MixedModel(fleet, (0, FRICTION))
    terms = [Term(0, np.ones(9)), Term(FRICTION, np.linspace(0.0, 1.0, 9))]
    components = Components(np.array([0.3, 0.6]), np.array([0.2, 0.5]))
    for i in (0, 1):
        profile = model.profile(terms, components, i)
        direct = model.estimate(terms, components).restricted
        found = profile.restricted(components.tau[i], components.kappa[i])
        np.testing.assert_allclose(found, direct, rtol=1e-9)


def test_a_free_effect_is_one_of_each_recording() -> None:
    fleet = draw_fleet(4, PLAN)
    terms = [Term(0, np.ones(9)), Term(3, np.linspace(0.0, 1.0, 9))]
    components = Components(np.array([0.3, 0.6]), np.array([0.2, 0.5]))
    free = np.zeros((9, 2), dtype=bool)
    free[[1, 4], 0] = free[4, 1] = True
    found = MixedModel(fleet, (0, 3), free).estimate(terms, components, with_bias=True)
    own = [Term(e, np.eye(9)[r]) for r, e in ((1, 0), (4, 0), (4, 3))]
    # Recordings with a separate size deviate by nothing else.
    expected = MixedModel(fleet, (0, 3)).estimate([*terms, *own], components, with_bias=True)
    for name in ("sizes", "covariance", "bias", "response"):
        np.testing.assert_allclose(
            getattr(found, name),
            getattr(expected, name)[..., :2, :2]
            if name in ("covariance", "bias")
            else getattr(expected, name)[:2],
            rtol=1e-4,
            atol=1e-9,
        )
    profile = MixedModel(fleet, (0, 3), free).profile(terms, components, 1)
    np.testing.assert_allclose(profile.restricted(0.6, 0.5), found.restricted, rtol=1e-9)


@pytest.mark.parametrize(("effect", "weak"), [(2, 0), (2, 1), (FRICTION, 1)])
def test_gains_are_those_of_one_problem_with_all_levels(effect: int, weak: int) -> None:
    fleet = draw_fleet(3, replace(PLAN, recordings=30, weak=weak))
    selection = Selection(replace(fleet, is_at_estimate=True))
    levels = (Level(SHARED), Level(CAR, car="car02"), Level(CAR, car="car01"))
    claims = [
        Candidate(e, z, z.design(fleet)) for e, z in zip((1, 1, effect), levels, strict=True)
    ]
    components = {1: (0.4, 0.7), effect: (0.2, 0.6)}
    model = FleetModel(tuple(claims), components, ("car01", "car03"))

    others = [c.term for c in claims]
    terms = [*others, *(Term(effect, z) for z in selection.examined_designs(model))]
    deviations = Components(np.array([0.4, 0.0]), np.array([0.7, 0.0]))
    # The strangers' effects are free but for those that are claimed or examined there.
    free = np.column_stack([np.array(fleet.cars) == "car03", np.zeros(30, dtype=bool)])
    free[:, 0] |= np.array(fleet.cars) == "car01"
    found = MixedModel(selection.fleet, (1, effect), free).estimate(terms, deviations)
    k = len(others)
    h, g = found.information, found.score
    across = np.linalg.solve(h[:k, :k], h[:k, k:])
    left = np.diag(h)[k:] - (h[:k, k:] * across).sum(axis=0)
    score = g[k:] - across.T @ g[:k]
    gains = selection.gains(model, effect)
    claimed = left < 1e-6 * np.diag(h)[k:]
    assert np.flatnonzero(claimed).tolist() == [selection.levels.index(levels[2])]
    np.testing.assert_array_equal(gains[claimed], 0.0)
    np.testing.assert_allclose(gains[~claimed], (score**2 / left)[~claimed], rtol=1e-6)


def test_gains_of_many_levels_fit_into_memory() -> None:
    """Every level times every other in each recording would be 240 MB."""
    fleet = draw_fleet(3, replace(PLAN, recordings=30))
    selection = Selection(fleet)
    selection.designs = np.random.default_rng(1).uniform(size=(1000, 30))
    tracemalloc.start()
    selection.gains(FleetModel((), {}), 2)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10e6


def test_the_bias_of_the_simulation_does_not_shrink_with_recordings() -> None:
    few = draw_fleet(5, PLAN)
    many = draw_fleet(5, FleetPlan(cars=3, recordings=90, effects=5, weak=1, bias=0.4))
    components = Components(np.array([0.1]), np.array([0.1]))

    def variances(fleet: object, count: int) -> tuple[float, float]:
        found = MixedModel(fleet, (0,)).estimate(  # type: ignore[arg-type]
            [Term(0, np.ones(count))], components, with_bias=True
        )
        return float(found.covariance[0, 0]), float(found.bias[0, 0])

    (noise_few, bias_few), (noise_many, bias_many) = variances(few, 9), variances(many, 90)
    assert noise_many < 0.5 * noise_few
    assert bias_many > 0.5 * bias_few


def test_the_likelihood_is_compiled_as_by_adk_compile() -> None:
    from adk_ros.api.kernel_calls import combine_a_fleet
    from adk_ros.fleet.inference import restricted_likelihood

    kernel: Any = restricted_likelihood._eliminated
    combine_a_fleet()
    compiled = list(kernel.signatures)
    model = MixedModel(draw_fleet(4, PLAN), (0,))
    components = Components(np.array([0.3]), np.array([0.2]))
    model.profile([Term(0, np.ones(9))], components, 0).restricted(0.1, 0.1)
    assert list(kernel.signatures) == compiled
