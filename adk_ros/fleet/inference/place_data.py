# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Evidence of a fleet at the cells of the map, and effects that act there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from adk_ros.fleet.inference.evidence import PLACE_ROW, Row
from adk_ros.fleet.inference.levels import MIN_RECORDINGS
from adk_ros.fleet.inference.place_evidence import Cell, PlaceEvidence
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class Place:
    """
    An effect's parameter at cells, on several recordings; sizes in materiality thresholds.

    `alternatives`: keys that explain the cells as well; `recordings`: names of those that pass
    there; `p_value`: of the most significant cell when it was found, of whatever effect, later of
    its cells together.
    """

    key: str
    cells: tuple[Cell, ...]
    size: float
    deviation: float
    freedom: float
    p_value: float
    recordings: tuple[str, ...]
    alternatives: tuple[str, ...] = ()

    @property
    def interval(self) -> tuple[float, float]:
        """The 90 % confidence interval of the size."""
        half = float(-stdtrit(self.freedom, 0.05)) * self.deviation
        return self.size - half, self.size + half


@dataclass(frozen=True)
class Visits:
    """The recordings (v) that pass a cell: index, s (v, q), h (v, q, q), c (v, q, d)."""

    recordings: tuple[int, ...]
    scores: FloatArray
    informations: FloatArray
    crosses: FloatArray


class PlaceData:
    """Evidence of a fleet at cells that at least `MIN_RECORDINGS` recordings pass."""

    def __init__(
        self, rows: Sequence[Row], names: Sequence[str], dispersion: Mapping[str, float]
    ) -> None:
        self.names = tuple(names)
        known = {name: i for i, name in enumerate(names)}
        found: dict[Cell, list[PlaceEvidence]] = {}
        self.keys: tuple[str, ...] = ()
        for row in rows:
            if row["kind"] == PLACE_ROW and row["recording"] in known:
                one = PlaceEvidence.from_row(row)
                self.keys = max(self.keys, one.keys, key=len)
                found.setdefault(one.cell, []).append(one)
        self.cells: dict[Cell, Visits] = {}
        for cell, visits in found.items():
            # Recordings whose channels do not show all effects are left out.
            whole = [v for v in visits if v.keys == self.keys]
            if len(whole) < MIN_RECORDINGS:
                continue
            over = np.array([dispersion[v.recording] for v in whole])
            self.cells[cell] = Visits(
                tuple(known[v.recording] for v in whole),
                np.array([v.score for v in whole]) / over[:, None],
                np.array([v.information for v in whole]) / over[:, None, None],
                np.array([v.cross for v in whole]) / over[:, None, None],
            )

    @property
    def tests(self) -> int:
        """Number of tests: parameters times cells."""
        return len(self.keys) * len(self.cells)

    def correction(
        self, places: Sequence[Place], known: Sequence[Place], shape: tuple[int, ...]
    ) -> FloatArray:
        """Return what new effects at places add to the scores (r, d)."""
        out = np.zeros(shape)
        for key, cell, size in _new(places, known):
            visits = self.cells.get(cell)
            if visits is not None:
                k = self.keys.index(key)
                np.add.at(out, list(visits.recordings), visits.crosses[:, k] * size)
        return out

    def saved_loss(
        self, places: Sequence[Place], known: Sequence[Place], recordings: int, origin: FloatArray
    ) -> FloatArray:
        """Return the loss (r,) that new effects at places save at a joint vector (d,)."""
        out = np.zeros(recordings)
        for key, cell, size in _new(places, known):
            visits = self.cells.get(cell)
            if visits is not None:
                k = self.keys.index(key)
                h = visits.informations[:, k, k]
                score = visits.scores[:, k] - visits.crosses[:, k] @ origin
                gain = 2.0 * score * size - h * size**2
                np.add.at(out, list(visits.recordings), gain)
        return out


def _new(places: Sequence[Place], known: Sequence[Place]) -> list[tuple[str, Cell, float]]:
    """
    Return key, cell and size of the effects at places that are not known.

    Recordings have no evidence of known places and the cells next to them
    (`place_evidence.away_from`), whatever is found there now.
    """
    before = {cell for place in known for cell in place.cells}
    return [
        (place.key, cell, place.size)
        for place in places
        for cell in place.cells
        if cell not in before and not any(cell.is_next_to(other) for other in before)
    ]
