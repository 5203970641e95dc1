# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of evidence of numerical fleets, at any estimate, for analyses in several passes."""

from __future__ import annotations

import numpy as np

from adk_ros.fleet.inference.evidence import RECORDING, SCHEMA, SIMULATION, Evidence, Row, packed
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.place_evidence import Cell

PLACE = Cell(15, 0, 0)
"""Where `rows_at` has a bank."""


def evidence_of(
    fleet: FleetEvidence, i: int, kind: str = RECORDING, at: FleetEstimate | None = None
) -> Evidence:
    columns, point = fleet.columns, np.zeros(fleet.columns.size)
    values = {} if at is None else at.point_of(fleet.names[i])
    for key, value in values.items():
        j = columns.first_effect + columns.effects.index(key)
        point[j] = value / columns.column(key).materiality
    gain = 2.0 * fleet.scores[i] @ point - point @ fleet.informations[i] @ point
    expected = float(fleet.expected_loss[i])
    return Evidence(
        fleet.names[i] if kind == RECORDING else kind,
        kind,
        columns,
        fleet.scores[i],
        fleet.informations[i],
        150.0,
        loss=float(expected + fleet.excess[i] - gain),
        expected_loss=expected,
        point=point,
        scatter=1e-6 * fleet.informations[i] if kind == SIMULATION else None,
        blocks=30,
    )


def rows_at(
    fleet: FleetEvidence, name: str, at: FleetEstimate | None, with_place: bool
) -> list[Row]:
    """Return the rows of a recording, with a bank of 6 thresholds in one of several cells."""
    i = fleet.names.index(name)
    placed = 0.0 if at is None else sum(p.size for p in at.places)
    rng = np.random.default_rng(i)
    places = [
        {
            "schema": SCHEMA,
            "kind": "place",
            "recording": name,
            "cell": Cell(5 * x, 0, 0).text,
            "counted_s": 4.0,
            "effects": "road_bank.bank",
            "score": packed(
                np.array([100.0 * (6.0 - placed) * (x == 3) + 10.0 * rng.standard_normal()])
            ),
            "information": packed(np.array([[100.0]])),
            "cross": np.zeros((1, fleet.columns.size), dtype="<f4").tobytes(),
        }
        for x in range(20 if with_place else 0)
    ]
    return [evidence_of(fleet, i, RECORDING, at).to_row(), *places]
