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
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence, RecordingTags
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
from adk_ros.fleet.inference.recording_evidence import evidence_rows


class MemoryFleet:
    """
    The drives of a plan and the simulation, also on each route of the fleet.

    Of what damages bags there is nothing.
    """

    def __init__(self, drives: FleetDrives) -> None:
        plan = drives.plan
        self._logs = {planned.name: drives.drive(planned) for planned in plan.drives}
        typical = self._logs[plan.drives[0].name]
        self.simulation = FleetSimulation.identify(
            drives.simulation(),
            typical,
            drives.nominal,
            further=[drives.further_simulation(i) for i in range(plan.size.routes)],
        )
        self._tags = {d.name: RecordingTags(d.car, d.day, d.tags) for d in plan.drives}

    def analysed(self) -> FleetAnalysis:
        """
        Return the analysis of all drives.

        :raises DataError: no drive has evidence.
        """
        return analyse_fleet(self._evidence_at, self.simulation, lambda rows: self._tags)

    def evidence(self) -> FleetEvidence:
        """
        Return the evidence of all drives, linearised without effects.

        :raises DataError: no drive has evidence.
        """
        rows, _ = self._evidence_at(None, None)
        return FleetEvidence.of([self.simulation.evidence.to_row(), *rows], self._tags)

    def _evidence_at(
        self, estimate: FleetEstimate | None, moved: Collection[str] | None
    ) -> tuple[list[Row], dict[str, str]]:
        rows: list[Row] = []
        failed: dict[str, str] = {}
        local = [] if estimate is None else estimate.local_values()
        usable = list(self._logs) if estimate is None else estimate.fleet.names
        for name in usable if moved is None else moved:
            values = {} if estimate is None else estimate.point_of(name)
            try:
                rows += evidence_rows(self._logs[name], self.simulation, values, local, name=name)
            except AdkError as error:
                failed[name] = str(error)
        return rows, failed
