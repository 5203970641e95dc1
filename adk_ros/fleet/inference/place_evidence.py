# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Evidence of a recording about effects at places.

A place is a cell of a grid in the map frame, driven through in one of eight directions: a grade
has the opposite sign on the way back. The derivative by an effect that acts in a cell is that by
the effect acting always, in the bins inside the cell: the observer forgets what was before within
half a second. With J_p those derivatives and J those by the joint vector, the row of a cell holds

    -J_p^T W (e - J x0),    J_p^T W J_p,    J_p^T W J,

so that the score at any estimate of the fleet follows without the recording.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.errors import DataError
from adk_ros.fleet.inference.evidence import (
    PLACE_ROW,
    SCHEMA,
    Column,
    Row,
    packed,
    place_columns,
    unpacked,
)
from adk_ros.fleet.inference.linearisation import Linearisation, effect_column
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.surrogate.residuals import ResidualProblem
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.numerics.levenberg_marquardt import huber_root

CELL_M = 60.0
"""Side of a cell, m: two to four seconds of driving, more than the whitening filters remember. By
choice."""
DIRECTIONS = 8
_MIN_BINS = 25
"""Least bins in a cell that count: 1 s."""
_LEAST_LEFT = 0.5
"""Share of a recording away from places, below which all of it counts. By choice."""


@dataclass(frozen=True)
class Cell:
    """A cell of the map: indices along x and y, and the direction, from 0 (along x) leftwards."""

    x: int
    y: int
    direction: int

    @property
    def text(self) -> str:
        """The cell in rows."""
        return f"{self.x}/{self.y}/{self.direction}"

    @classmethod
    def of_text(cls, text: str) -> Cell:
        """Return the cell of a row."""
        x, y, direction = (int(part) for part in text.split("/"))
        return cls(x, y, direction)

    @property
    def centre(self) -> tuple[float, float]:
        """Centre in the map frame, m."""
        return (self.x + 0.5) * CELL_M, (self.y + 0.5) * CELL_M

    def is_next_to(self, other: Cell) -> bool:
        """Whether two cells touch and are driven in directions at most an eighth apart."""
        turn = (self.direction - other.direction) % DIRECTIONS
        return (
            abs(self.x - other.x) <= 1
            and abs(self.y - other.y) <= 1
            and turn in {0, 1, DIRECTIONS - 1}
        )


@dataclass(frozen=True)
class PlaceEvidence:
    """Evidence of a recording at a cell about the effects `keys` (q), in scaled units."""

    recording: str
    cell: Cell
    seconds: float
    keys: tuple[str, ...]
    score: FloatArray
    information: FloatArray
    cross: FloatArray
    """(q, d) with the joint vector."""

    @classmethod
    def from_row(cls, row: Row) -> PlaceEvidence:
        """
        Return the evidence of a row.

        :raises DataError: the row has another schema.
        """
        if row.get("schema") != SCHEMA:
            raise DataError(f"evidence of {row.get('recording', '?')}: compute it again")
        keys = tuple(str(row["effects"]).split(","))
        q = len(keys)
        cross = np.frombuffer(row["cross"], dtype="<f4").astype(np.float64)
        return cls(
            str(row["recording"]),
            Cell.of_text(str(row["cell"])),
            float(row["counted_s"]),
            keys,
            unpacked(row["score"], (q,)),
            unpacked(row["information"], (q, q)),
            cross.reshape(q, -1),
        )


def cells_along(poses: FloatArray) -> IntArray:
    """Return the cells (n, 3) of poses (n, 3): x, y, heading."""
    direction = np.rint(poses[:, 2] / (2.0 * np.pi / DIRECTIONS)).astype(np.int64) % DIRECTIONS
    at = np.floor(poses[:, :2] / CELL_M).astype(np.int64)
    return np.column_stack([at, direction])


def in_cells(problem: ResidualProblem, cells: Sequence[Cell]) -> FloatArray:
    """Return the weight (n,) of an effect that acts in cells, at each step."""
    at = cells_along(problem.pose)
    inside = np.zeros(problem.steps, dtype=bool)
    for cell in cells:
        inside |= (at == (cell.x, cell.y, cell.direction)).all(axis=1)
    return inside.astype(np.float64)


def away_from(problem: ResidualProblem, cells: Collection[Cell]) -> BoolArray:
    """
    Return which bins (n,) are neither in any of these cells nor in one next to it.

    An effect begins and ends somewhere within a cell: what one size per cell leaves there is
    nothing else. All bins, if that would leave less than `_LEAST_LEFT` of them.
    """
    at = _cells_of_bins(problem)
    inside = np.zeros(len(at), dtype=bool)
    for x, y, direction in np.unique(at, axis=0).tolist():
        here = Cell(x, y, direction)
        if here in cells or any(here.is_next_to(cell) for cell in cells):
            inside |= (at == (x, y, direction)).all(axis=1)
    return ~inside if inside.mean() <= 1.0 - _LEAST_LEFT else np.ones(len(at), dtype=bool)


def _cells_of_bins(problem: ResidualProblem) -> IntArray:
    """Return the cell (n, 3) of the middle of each bin."""
    return cells_along(
        np.column_stack([problem.binned(problem.pose[:, i].copy()) for i in range(3)])
    )


def place_rows(
    name: str,
    likelihood: Likelihood,
    linear: Linearisation,
    values: Mapping[str, float],
    columns: Sequence[Column],
    placed: Sequence[ActiveEffect] = (),
) -> list[Row]:
    """
    Return one row per cell; `values` and `placed`: where `linear` was linearised.

    Sizes are relative to the effects `placed`, which act all the same.
    """
    problem, residuals = likelihood.problem, linear.unweighted
    local = [
        c for c in place_columns(likelihood.effects)
        if c.effect.name not in likelihood.unobservable
    ]  # fmt: skip
    if not local:
        return []
    keys = [c.key for c in local]
    at_places = {active.effect.name for active in placed}
    root = huber_root(residuals)
    derivatives = np.column_stack(
        [
            effect_column(
                likelihood, residuals, columns, c, values, placed, c.effect.name in at_places
            )
            * root
            for c in local
        ]
    )
    derivatives[residuals == 0.0] = 0.0
    bins = problem.bins
    at = _cells_of_bins(problem)
    corrected = linear.residuals - linear.jacobian @ linear.point
    counted = (likelihood.weights > 0.0).any(axis=0)
    rows: list[Row] = []
    for cell in np.unique(at[counted], axis=0):
        inside = (at == cell).all(axis=1) & counted
        if np.count_nonzero(inside) < _MIN_BINS:
            continue
        used = np.flatnonzero(np.tile(inside, 6))
        assert used.size == 0 or used[-1] < 6 * bins
        part = derivatives[used]
        rows.append(
            {
                "schema": SCHEMA,
                "kind": PLACE_ROW,
                "recording": name,
                "cell": Cell(*(int(v) for v in cell)).text,
                "counted_s": float(np.count_nonzero(inside) * 0.04),
                "effects": ",".join(keys),
                "score": packed(-part.T @ corrected[used]),
                "information": packed(part.T @ part),
                "cross": (part.T @ linear.jacobian[used]).astype("<f4").tobytes(),
            }
        )
    return rows
