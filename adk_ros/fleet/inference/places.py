# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Effects at places of a fleet: the same cell of the map, on several recordings.

At the fleet's estimate of all else, the evidence of recording r at a cell about a parameter is a
score s_r and an information h_r. The size of the cell is sum s / sum h; its variance is the larger
of 1 / sum h and that of the scatter between recordings (J. Hartung, G. Knapp, "On tests of the
overall treatment effect in meta-analysis with normally distributed responses", Statistics in
Medicine 20 (2001) 1771), with Student's t over the recordings.

The surrogate's error depends on the manoeuvre, so the same bend feigns the same effect every day.
How large such effects are is seen in all other cells (an empirical null; B. Efron, "Large-scale
simultaneous hypothesis testing", J. Am. Stat. Assoc. 99 (2004) 96). An error of the accelerations
feigns a size that is the larger, the less a cell informs about the parameter: it multiplies the
variance of noise. An error of the parameter itself adds the same variance in every cell. Both
follow from the robust deviations of the sizes from their median, the former in the half of the
cells with the least information, the latter in the other half. Neither shrinks with the number of
recordings.

The most significant cell is taken, with the adjoining ones that are significant for the same
parameter; its effect is subtracted, and the search goes on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr, stdtrit

from adk_ros.fleet.inference.evidence import PLACE_ROW, Row, column_of
from adk_ros.fleet.inference.levels import MIN_RECORDINGS
from adk_ros.fleet.inference.place_evidence import Cell, PlaceEvidence
from adk_ros.mismatch.library.criteria import (
    INDISTINGUISHABLE_LOSS,
    SYSTEMATIC_ERROR_PER_MATERIALITY,
    SYSTEMATIC_ERROR_SHARE,
)
from adk_ros.numerics.arrays import FloatArray

_MAD_TO_SIGMA = 1.4826
"""Standard deviation over median absolute deviation, of a Gaussian."""
_MIN_CELLS = 10
"""Least cells that determine the deviation of the surrogate's error between places."""
_NULL_ROUNDS = 50
"""Rounds in which the two parts of that error are fitted in turn, until neither changes."""
_MAX_PLACES = 20
"""Most places of a selection; bounds the time. By choice."""


@dataclass(frozen=True)
class Place:
    """
    An effect's parameter at cells, on several recordings; sizes in materiality thresholds.

    `alternatives`: keys that explain the cells as well; `recordings`: number that pass there.
    """

    key: str
    cells: tuple[Cell, ...]
    size: float
    deviation: float
    freedom: float
    p_value: float
    recordings: int
    alternatives: tuple[str, ...] = ()

    @property
    def interval(self) -> tuple[float, float]:
        """The 90 % confidence interval of the size."""
        half = float(-stdtrit(self.freedom, 0.05)) * self.deviation
        return self.size - half, self.size + half


@dataclass(frozen=True)
class _Visits:
    """The recordings (v) that pass a cell: index, s (v, q), h (v, q, q), c (v, q, d)."""

    recordings: tuple[int, ...]
    scores: FloatArray
    informations: FloatArray
    crosses: FloatArray


@dataclass(frozen=True)
class _CellTest:
    """Size of one parameter at one cell."""

    size: float
    variance: float
    freedom: float
    gain: float


@dataclass(frozen=True)
class _Null:
    """Sizes of a parameter where nothing acts: median, variance, factor on that of noise."""

    centre: float
    spread: float
    inflation: float


class PlaceData:
    """Evidence of a fleet at cells that at least `MIN_RECORDINGS` recordings pass."""

    def __init__(
        self, rows: Sequence[Row], names: Sequence[str], dispersion: Mapping[str, float]
    ) -> None:
        known = {name: i for i, name in enumerate(names)}
        found: dict[Cell, list[PlaceEvidence]] = {}
        self.keys: tuple[str, ...] = ()
        for row in rows:
            if row["kind"] == PLACE_ROW and row["recording"] in known:
                one = PlaceEvidence.from_row(row)
                self.keys = max(self.keys, one.keys, key=len)
                found.setdefault(one.cell, []).append(one)
        self.cells: dict[Cell, _Visits] = {}
        for cell, visits in found.items():
            # Recordings whose channels do not show all effects are left out.
            whole = [v for v in visits if v.keys == self.keys]
            if len(whole) < MIN_RECORDINGS:
                continue
            over = np.array([dispersion[v.recording] for v in whole])
            self.cells[cell] = _Visits(
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
        """Return what the effects at places, beyond `known` ones, add to the scores (r, d)."""
        out = np.zeros(shape)
        before = {(p.key, p.cells): p.size for p in known}
        for place in places:
            k = self.keys.index(place.key)
            size = place.size - before.get((place.key, place.cells), 0.0)
            for cell in place.cells:
                visits = self.cells.get(cell)
                for v, r in enumerate(visits.recordings if visits is not None else ()):
                    assert visits is not None
                    out[r] += visits.crosses[v, k] * size
        return out

    def saved_loss(
        self, places: Sequence[Place], known: Sequence[Place], recordings: int
    ) -> FloatArray:
        """Return the loss (r,) that the effects at places, beyond `known` ones, save."""
        out = np.zeros(recordings)
        before = {(p.key, p.cells): p.size for p in known}
        for place in places:
            k = self.keys.index(place.key)
            size = place.size - before.get((place.key, place.cells), 0.0)
            for cell in place.cells:
                visits = self.cells.get(cell)
                if visits is not None:
                    h = visits.informations[:, k, k]
                    gain = 2.0 * visits.scores[:, k] * size - h * size**2
                    np.add.at(out, list(visits.recordings), gain)
        return out

    def select(
        self, at: FloatArray, significance: float, known: Sequence[Place] = ()
    ) -> list[Place]:
        """
        Return the effects at places, given the joint vector (r, d) of each recording.

        `significance`: largest p-value of a single test; `known`: places at whose sizes the
        recordings were linearised, to which what is left there is added.
        """
        scores = {
            cell: v.scores - np.einsum("vqd,vd->vq", v.crosses, at[list(v.recordings)])
            for cell, v in self.cells.items()
        }
        places: list[Place] = []
        blocked: set[tuple[Cell, str]] = set()
        for place in known:
            k = self.keys.index(place.key)
            cells = [cell for cell in place.cells if cell in scores]
            of_place = [
                _cell_test(scores[cell][:, k], self.cells[cell].informations[:, k, k])
                for cell in cells
            ]
            weights = np.array([1.0 / t.variance if t.variance > 0.0 else 0.0 for t in of_place])
            if weights.sum() > 0.0:
                change = float(weights @ np.array([t.size for t in of_place]) / weights.sum())
                places.append(replace(place, size=place.size + change))
                for cell in cells:
                    scores[cell] = scores[cell] - self.cells[cell].informations[:, :, k] * change
            # What a linearisation leaves at a place is no second effect there, nor next to it.
            near = {c for c in self.cells if any(c.is_next_to(cell) for cell in place.cells)}
            blocked |= {(cell, key) for cell in near.union(place.cells) for key in self.keys}
        while len(places) < _MAX_PLACES:
            found = self._best(scores, significance, blocked)
            if found is None:
                break
            places.append(found)
            k = self.keys.index(found.key)
            for cell in found.cells:
                scores[cell] = scores[cell] - self.cells[cell].informations[:, :, k] * found.size
                blocked |= {(cell, key) for key in (found.key, *found.alternatives)}
        return places

    def _best(
        self,
        scores: Mapping[Cell, FloatArray],
        significance: float,
        blocked: set[tuple[Cell, str]],
    ) -> Place | None:
        tests: dict[tuple[Cell, str], _CellTest] = {}
        for k, key in enumerate(self.keys):
            of_key = {
                cell: _cell_test(scores[cell][:, k], visits.informations[:, k, k])
                for cell, visits in self.cells.items()
            }
            null = _null_of(list(of_key.values()))
            for cell, test in of_key.items():
                if test.variance > 0.0:
                    size = test.size - null.centre
                    inexact = SYSTEMATIC_ERROR_PER_MATERIALITY**2
                    inexact += (SYSTEMATIC_ERROR_SHARE * size) ** 2
                    variance = null.inflation * test.variance + null.spread + inexact
                    tests[cell, key] = _CellTest(size, variance, test.freedom, test.gain)
        good = {
            pair: test
            for pair, test in tests.items()
            if _p_value(test) < significance and abs(test.size) >= 1.0 and pair not in blocked
        }
        if not good:
            return None
        (seed, key), _ = max(good.items(), key=lambda item: item[1].gain)
        same = {cell for cell, of in good if of == key}
        same = {c for c in same if np.sign(good[c, key].size) == np.sign(good[seed, key].size)}
        cells = _connected(seed, same)
        members = [tests[cell, key] for cell in cells]
        weights = np.array([1.0 / test.variance for test in members])
        size = float(weights @ np.array([test.size for test in members]) / weights.sum())
        gains = {
            other: sum(tests[cell, other].gain for cell in cells if (cell, other) in tests)
            for other in self.keys
        }
        alternatives = tuple(
            other
            for other in self.keys
            if other != key and gains[key] - gains[other] < INDISTINGUISHABLE_LOSS
        )
        best = max(members, key=lambda test: test.gain)
        return Place(
            key,
            tuple(sorted(cells, key=lambda c: (c.x, c.y, c.direction))),
            size,
            float(np.sqrt(1.0 / weights.sum() + SYSTEMATIC_ERROR_PER_MATERIALITY**2)),
            best.freedom,
            _p_value(best),
            max(len(self.cells[cell].recordings) for cell in cells),
            alternatives,
        )


def _cell_test(scores: FloatArray, informations: FloatArray) -> _CellTest:
    """Return the size of a parameter from the scores and informations (v,) of recordings."""
    total = float(informations.sum())
    count = int(np.count_nonzero(informations > 0.0))
    if count < MIN_RECORDINGS or total <= 0.0:
        return _CellTest(0.0, 0.0, 1.0, 0.0)
    size = float(scores.sum()) / total
    scatter = float(((scores - informations * size) ** 2).sum()) / total**2
    variance = max(1.0 / total, scatter * count / (count - 1.0))
    return _CellTest(size, variance, count - 1.0, size**2 / variance)


def _null_of(tests: Sequence[_CellTest]) -> _Null:
    """Return what a parameter's sizes over cells show of the surrogate's error."""
    used = [test for test in tests if test.variance > 0.0]
    if len(used) < _MIN_CELLS:
        return _Null(0.0, 1.0, 1.0)
    sizes = np.array([test.size for test in used])
    variances = np.array([test.variance for test in used])
    centre = float(np.median(sizes))
    uncertain = variances > np.median(variances)
    inflation, spread = 1.0, 0.0
    for _ in range(_NULL_ROUNDS):
        # Squared robust deviation in units of the expected one: one, if the null is right.
        scaled = (sizes - centre)[uncertain] ** 2 / (variances[uncertain] + spread / inflation)
        inflation = max(_MAD_TO_SIGMA**2 * float(np.median(scaled)), 1.0)
        precise = _MAD_TO_SIGMA**2 * float(np.median((sizes - centre)[~uncertain] ** 2))
        spread = max(precise - inflation * float(np.median(variances[~uncertain])), 0.0)
    return _Null(centre, spread, inflation)


def _p_value(test: _CellTest) -> float:
    return 2.0 * float(stdtr(test.freedom, -abs(test.size) / np.sqrt(test.variance)))


def _connected(seed: Cell, cells: set[Cell]) -> list[Cell]:
    """Return the cells that adjoin the seed, directly or through others."""
    found, front = {seed}, [seed]
    while front:
        here = front.pop()
        new = {cell for cell in cells - found if cell.is_next_to(here)}
        found |= new
        front += new
    return list(found)


def materiality_of(place: Place) -> float:
    """Return the size of a unit of the place's size, in the fitted variable."""
    return column_of(place.key).materiality
