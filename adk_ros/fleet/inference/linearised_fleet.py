# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of evidence of the recordings of a fleet, and at which effects they are linearised."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from adk_ros.fleet.inference.evidence import PLACE_ROW, RECORDING, Row
from adk_ros.fleet.inference.fleet_estimate import EvidenceAt, FleetEstimate
from adk_ros.fleet.inference.linearisation_point import Point, has_moved
from adk_ros.fleet.inference.place_evidence import Cell


class LinearisedFleet:
    """
    The rows of each recording, and where they are linearised.

    `failed`: recordings without evidence -> reason; `outdated`: those with evidence of an earlier
    pass only.
    """

    def __init__(self, evidence_at: EvidenceAt) -> None:
        self._evidence_at = evidence_at
        self._rows: dict[str, list[Row]] = {}
        self._points: dict[str, Point] = {}
        self.failed: dict[str, str] = {}
        self.outdated: dict[str, str] = {}

    def update(
        self,
        at: FleetEstimate | None,
        names: Collection[str] | None,
        passing: Collection[str] = frozenset(),
    ) -> None:
        """Linearise recordings, None for all; `passing`: that pass a place which has moved."""
        if names is not None and not names:
            return
        found, without = self._evidence_at(at, names)
        by_name: dict[str, list[Row]] = {}
        for row in found:
            by_name.setdefault(str(row["recording"]), []).append(row)
        self._rows.update(by_name)
        for name in by_name:
            self._points[name] = {} if at is None else _in_thresholds(at, at.point_of(name))
            self.outdated.pop(name, None)
        for name, why in without.items():
            (self.outdated if name in self._rows else self.failed)[name] = why
            if name in self._rows and name in passing:
                # Others are linearised again at a place of which its rows do not know.
                self._rows[name] = [r for r in self._rows[name] if r["kind"] == RECORDING]

    def every_row(self, names: Collection[str] | None = None) -> list[Row]:
        """Return the rows of recordings, of all by default."""
        chosen = sorted(self._rows if names is None else names)
        return [row for name in chosen for row in self._rows[name]]

    def loss_ratios(self) -> dict[str, float]:
        """Return the loss of each recording over that of a perfect model."""
        return {
            name: float(row["loss_ratio"])
            for name, rows in self._rows.items()
            for row in rows
            if row["kind"] == RECORDING
        }

    def usable(self, names: Collection[str]) -> dict[str, list[Row]]:
        """Return the rows of those recordings that did not fail when they were due."""
        return {n: self._rows[n] for n in self._rows if n in names and n not in self.outdated}

    def moved_to(self, at: FleetEstimate, names: Collection[str]) -> set[str]:
        """Return the recordings whose effects at an estimate are others than those of the rows."""
        return {
            name
            for name in self.usable(names)
            if has_moved(self._points[name], _in_thresholds(at, at.values_of(name)))
        }

    def passing(self, cells: Collection[Cell], names: Collection[str]) -> set[str]:
        """Return the recordings that pass any of these cells."""
        return {n for n, rows in self.usable(names).items() if cells and _passes(rows, cells)}


def _in_thresholds(estimate: FleetEstimate, values: Mapping[str, float]) -> Point:
    columns = estimate.fleet.columns
    return {key: value / columns.column(key).materiality for key, value in values.items()}


def _passes(rows: Sequence[Row], cells: Collection[Cell]) -> bool:
    """
    Whether a recording passes any of these cells, or one beside it.

    One that only cuts a corner of a cell has no row of it, but one of a neighbour.
    """
    near = {(c.x + i, c.y + j) for c in cells for i in (-1, 0, 1) for j in (-1, 0, 1)}
    driven = (Cell.of_text(str(row["cell"])) for row in rows if row["kind"] == PLACE_ROW)
    return any((cell.x, cell.y) in near for cell in driven)
