# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Numerical fleets: columns that resemble each other, and the evidence of their recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adk_ros.fleet.inference.evidence import RECORDING, Evidence, Row, column_of
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import FleetModel
from adk_ros.numerics.arrays import FloatArray

MISFIT = 400.0
"""Loss per squared difference of the size from the true one, in materiality thresholds."""


def with_same_derivatives(fleet: FleetEvidence, column: int, as_column: int) -> FleetEvidence:
    """Return a fleet in which a column has the derivatives of another one."""
    informations, scores = fleet.informations.copy(), fleet.scores.copy()
    informations[:, column] = fleet.informations[:, as_column]
    informations[:, :, column] = informations[:, :, as_column]
    informations[:, column, column] = fleet.informations[:, as_column, as_column]
    scores[:, column] = fleet.scores[:, as_column]
    return replace(fleet, informations=informations, scores=scores)


def with_unlisted_fault(
    fleet: FleetEvidence, car: str, column: int, sizes: FloatArray, unexplained: float = 50_000.0
) -> FleetEvidence:
    """
    Return a fleet whose car has a fault that nothing explains, as other physics would.

    It moves an effect (`column` of the joint vector) by `sizes` (r,) in the car's recordings.
    `unexplained`: loss of each that stays.
    """
    scores, excess = fleet.scores.copy(), fleet.excess.copy()
    for i in np.flatnonzero(np.array(fleet.cars) == car):
        h = fleet.informations[i]
        scores[i] += h[:, column] * sizes[i]
        excess[i] += unexplained + h[column, column] * sizes[i] ** 2
    return replace(fleet, scores=scores, excess=excess)


def evidence_of(fleet: FleetEvidence, i: int) -> Evidence:
    return Evidence(
        fleet.names[i],
        RECORDING,
        fleet.columns,
        fleet.scores[i],
        fleet.informations[i],
        150.0,
        loss=float(fleet.expected_loss[i] + fleet.excess[i]),
        expected_loss=float(fleet.expected_loss[i]),
    )


def row_of(fleet: FleetEvidence, i: int) -> Row:
    return evidence_of(fleet, i).to_row()


def row_at(
    estimate: FleetEstimate, name: str, key: str, truth: float, excess: float = -300.0
) -> Row:
    """
    Return the evidence of a recording linearised with a parameter, whose true size is `truth`.

    `excess`: loss that the true size leaves, above that of a perfect model.
    """
    fleet = estimate.fleet
    i = fleet.names.index(name)
    columns = fleet.columns
    lag = estimate.values_of(name)[key] / column_of(key).materiality
    j = columns.first_effect + columns.effects.index(key)
    information = np.zeros((columns.size, columns.size))
    information[j, j] = MISFIT
    score = np.zeros(columns.size)
    score[j] = MISFIT * truth
    point = np.zeros(columns.size)
    point[j] = lag
    expected = float(fleet.expected_loss[i])
    return Evidence(
        name,
        RECORDING,
        columns,
        score,
        information,
        150.0,
        loss=expected + excess + MISFIT * (lag - truth) ** 2,
        expected_loss=expected,
        point=point,
    ).to_row()


def claimed(fleet: FleetEvidence, model: FleetModel) -> set[tuple[str, str]]:
    """Return parameter and level of each claim."""
    return {(fleet.columns.effects[c.effect], c.level.text) for c in model.claimed}
