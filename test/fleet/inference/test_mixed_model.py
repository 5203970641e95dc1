# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The hierarchical model: equal to dense generalised least squares, and its own short cut."""

from __future__ import annotations

import numpy as np

from adk_ros.fleet.inference.mixed_model import Components, MixedModel, Term
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, draw_fleet

PLAN = FleetPlan(cars=3, recordings=9, effects=4, weak=1, bias=0.4)


def test_equals_dense_least_squares() -> None:
    fleet = draw_fleet(3, PLAN)
    tau, kappa = np.array([0.4, 0.2]), np.array([0.7, 0.1])
    active = (1, 2)
    car = np.array([fleet.car_names.index(c) for c in fleet.cars])
    designs = [np.ones(9), (car == 1).astype(float)]
    terms = [Term(1, designs[0]), Term(2, designs[1])]
    found = MixedModel(fleet, active).estimate(terms, Components(tau, kappa), with_bias=True)

    # All variables at once: beta, weak directions, those of each car, those of each recording.
    c = fleet.columns
    first = c.first_effect
    m, per_car, per_recording = 2, 15 + 2, 3 + 2
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
            p[first + effect, own + 15 + i] = kappa[i]
            p[first + effect, single + 3 + i] = tau[i]
            p[first + effect, i] = designs[i][r]
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
    np.testing.assert_allclose(
        found.car_deviations[:, 0],
        [kappa[0] * (inverse @ right)[m + 1 + k * per_car + 15] for k in range(3)],
        rtol=1e-4,
    )


def test_the_profile_is_the_restricted_likelihood() -> None:
    fleet = draw_fleet(4, PLAN)
    model = MixedModel(fleet, (0, 3))
    terms = [Term(0, np.ones(9)), Term(3, np.linspace(0.0, 1.0, 9))]
    components = Components(np.array([0.3, 0.6]), np.array([0.2, 0.5]))
    for i in (0, 1):
        profile = model.profile(terms, components, i)
        direct = model.estimate(terms, components).restricted
        found = profile.restricted(components.tau[i], components.kappa[i])
        np.testing.assert_allclose(found, direct, rtol=1e-9)


def test_the_bias_of_the_simulation_does_not_shrink_with_recordings() -> None:
    few = draw_fleet(5, PLAN)
    many = draw_fleet(5, FleetPlan(cars=3, recordings=90, effects=4, weak=1, bias=0.4))
    components = Components(np.array([0.1]), np.array([0.1]))

    def variances(fleet: object, count: int) -> tuple[float, float]:
        found = MixedModel(fleet, (0,)).estimate(  # type: ignore[arg-type]
            [Term(0, np.ones(count))], components, with_bias=True
        )
        return float(found.covariance[0, 0]), float(found.bias[0, 0])

    (noise_few, bias_few), (noise_many, bias_many) = variances(few, 9), variances(many, 90)
    assert noise_many < 0.5 * noise_few
    assert bias_many > 0.5 * bias_few
