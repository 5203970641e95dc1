# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Numerical fleets with columns that resemble each other."""

from __future__ import annotations

from dataclasses import replace

from adk_ros.fleet.inference.fleet_evidence import FleetEvidence


def with_same_derivatives(fleet: FleetEvidence, column: int, as_column: int) -> FleetEvidence:
    """Return a fleet in which a column has the derivatives of another one."""
    informations, scores = fleet.informations.copy(), fleet.scores.copy()
    informations[:, column] = fleet.informations[:, as_column]
    informations[:, :, column] = informations[:, :, as_column]
    informations[:, column, column] = fleet.informations[:, as_column, as_column]
    scores[:, column] = fleet.scores[:, as_column]
    return replace(fleet, informations=informations, scores=scores)
