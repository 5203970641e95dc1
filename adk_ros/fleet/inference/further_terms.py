# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The evidence of many designs of one effect, each as a single further term next to the same others.

As terms of one problem they need a matrix of designs times designs in every recording: gigabytes
for all levels of a hundred cars. Of this matrix only the diagonal and what the designs share with
the other terms matters, which is linear in the number of designs.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from adk_ros.fleet.inference.restricted_likelihood import MIN_INFORMATION, Profile
from adk_ros.numerics.arrays import FloatArray

_LEAST_SHARE = 1e-6
"""Share of its information that a term keeps next to the others, or they say the same."""


def evidence_of_designs(profile: Profile, designs: FloatArray) -> FloatArray:
    """
    Return the evidence (l,) of each design (l, r) as a further term of the profile's effect.

    Score squared over information, with all else and the sizes of the other terms eliminated; zero
    for a design that the other terms say already. The effect itself does not deviate.
    """
    deviations = profile.deviations.copy()
    deviations[profile.position] = 0.0
    left = profile.informations.shape[1] - deviations.size
    h_sum, right_sum = np.zeros((left, left)), np.zeros((left, 1 + designs.shape[0]))
    information, score = designs**2 @ profile.own, designs @ profile.score
    for c, h in enumerate(profile.informations):
        of_car = profile.car == c
        # The score, and what each design shares with all other variables.
        rights = np.column_stack(
            [profile.scores[c], (designs[:, of_car] @ profile.rows[of_car]).T]
        )
        rest, right, root = _eliminated(h, rights, deviations)
        h_sum += rest
        right_sum += right
        information -= (root[:, 1:] ** 2).sum(axis=0)
        score -= root[:, 0] @ root[:, 1:]
    h, rights, root = _eliminated(h_sum, right_sum, np.ones(profile.weak))
    information -= (root[:, 1:] ** 2).sum(axis=0)
    score -= root[:, 0] @ root[:, 1:]
    information += MIN_INFORMATION
    terms = h + MIN_INFORMATION * np.eye(h.shape[0])
    solved = np.linalg.solve(terms, rights)
    kept = information - (rights[:, 1:] * solved[:, 1:]).sum(axis=0)
    score -= rights[:, 1:].T @ solved[:, 0]
    usable = kept > _LEAST_SHARE * np.maximum(information, 1e-12)
    return np.asarray(np.where(usable, score**2 / np.where(usable, kept, 1.0), 0.0))


def _eliminated(
    information: FloatArray, rights: FloatArray, deviations: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Integrate over the first variables, with prior N(0, deviations^2) (k,).

    `information` (n, n), `rights` (n, q); returns those of the other variables, and (k, q) whose
    products are what the integral takes from the products of the right-hand sides.
    """
    k = deviations.size
    scaled = deviations[:, None] * information[:k]
    inner = np.linalg.cholesky(scaled[:, :k] * deviations + np.eye(k))
    across = solve_triangular(inner, scaled[:, k:], lower=True)
    root = solve_triangular(inner, deviations[:, None] * rights[:k], lower=True)
    return (
        information[k:, k:] - across.T @ across,
        rights[k:] - across.T @ root,
        np.asarray(root),
    )
