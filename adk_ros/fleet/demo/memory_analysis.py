# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulate a synthetic fleet and analyse it in this process, without files."""

from __future__ import annotations

from collections.abc import Collection

from adk_ros.errors import AdkError
from adk_ros.fleet.demo.fleet_drives import FleetDrives
from adk_ros.fleet.inference.analysis import FleetAnalysis, analyse_fleet
from adk_ros.fleet.inference.evidence import Row
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import RecordingTags
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
from adk_ros.fleet.inference.recording_evidence import evidence_rows


def analyse_in_memory(drives: FleetDrives) -> FleetAnalysis:
    """
    Return the analysis of all drives of a fleet; of what damages their bags there is nothing.

    :raises DataError: no drive has evidence.
    """
    plan = drives.plan
    logs = {planned.name: drives.drive(planned) for planned in plan.drives}
    typical = logs[plan.drives[0].name]
    simulation = FleetSimulation.identify(drives.simulation(), typical, drives.nominal)
    tags = {d.name: RecordingTags(d.car, d.day, d.tags) for d in plan.drives}

    def evidence_at(
        estimate: FleetEstimate | None, moved: Collection[str] | None
    ) -> tuple[list[Row], dict[str, str]]:
        rows: list[Row] = []
        failed: dict[str, str] = {}
        local = [] if estimate is None else estimate.local_values()
        usable = list(logs) if estimate is None else estimate.fleet.names
        for name in usable if moved is None else moved:
            values = {} if estimate is None else estimate.point_of(name)
            try:
                rows += evidence_rows(logs[name], simulation, values, local, name=name)
            except AdkError as error:
                failed[name] = str(error)
        return rows, failed

    return analyse_fleet(evidence_at, simulation, lambda rows: tags)
