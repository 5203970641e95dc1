# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Effects at places of a fleet: the same cell of the map, on several recordings.

Each cell is tested for each parameter against an empirical null (`cell_tests`).
The most significant cell says that something acts there. What it is, the cells around say as well:
of all effects the one that explains most there is taken (`place_comparison`), with the adjoining
cells that show it. It is subtracted, and the search goes on.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from adk_ros.fleet.inference.cell_tests import (
    CellTest,
    cell_test,
    deviation_of,
    is_claimable,
    null_of,
    p_value,
    tail_of,
    together,
)
from adk_ros.fleet.inference.place_comparison import evidence
from adk_ros.fleet.inference.place_data import Place, PlaceData
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.mismatch.library.criteria import (
    INDISTINGUISHABLE_LOSS,
    SYSTEMATIC_ERROR_PER_MATERIALITY,
    SYSTEMATIC_ERROR_SHARE,
)
from adk_ros.numerics.arrays import FloatArray

_REACH = 3
"""
Cells from a place within which there is no second one: a block of residuals, 5 s, in which they
count as dependent (`mismatch.inference.block_scores`), passes three cells of 60 m at 130 km/h.
"""
_SHOWS = 0.05
"""
Largest p-value, of a single test, of a cell near the most significant one that shows the effect of
a place. By choice: whether something acts there is decided by the most significant cell.
"""
_MAX_PLACES = 20
"""Most places of a selection; bounds the time. By choice."""


def select_places(
    data: PlaceData, at: FloatArray, significance: float, known: Sequence[Place] = ()
) -> list[Place]:
    """
    Return the effects at places, given the joint vector (r, d) of each recording.

    `significance`: largest p-value of a single test; `known`: places at whose sizes the recordings
    were linearised. What is left there is added; those that are not significant any more are
    dropped.
    """
    return _PlaceSearch(data, significance).select(at, known)


class _PlaceSearch:
    """A search at one level of significance."""

    def __init__(self, data: PlaceData, significance: float) -> None:
        self._cells, self._keys, self._names = data.cells, data.keys, data.names
        self._significance = significance

    def select(self, at: FloatArray, known: Sequence[Place]) -> list[Place]:
        """Return the effects at places."""
        scores = {
            cell: v.scores - np.einsum("vqd,vd->vq", v.crosses, at[list(v.recordings)])
            for cell, v in self._cells.items()
        }
        places: list[Place] = []
        blocked: set[tuple[Cell, str]] = set()
        for place in known:
            self._subtract(replace(place, size=-place.size), scores)
            kept = self._estimated_again(place, scores)
            if kept is not None:
                self._subtract(kept, scores)
                places.append(kept)
                blocked |= self._around(kept)
        while len(places) < _MAX_PLACES:
            found = self._best(scores, blocked)
            if found is None:
                break
            self._subtract(found, scores)
            places.append(found)
            blocked |= self._around(found)
        return places

    def _subtract(self, place: Place, scores: dict[Cell, FloatArray]) -> None:
        """Take what a place explains from the scores."""
        k = self._keys.index(place.key)
        for cell in place.cells:
            if cell in scores:
                products = self._cells[cell].informations[:, :, k]
                scores[cell] = scores[cell] - products * place.size

    def _estimated_again(self, place: Place, scores: Mapping[Cell, FloatArray]) -> Place | None:
        """
        Return a known place from the scores without it, None if it is not claimable any more.

        One of which one cell was significant stays while its cells together are. It was named
        before other effects were known: another one that explains more of it now is its name.
        """
        of_keys = {key: self._tests_of(k, scores) for k, key in enumerate(self._keys)}
        cells = [cell for cell in place.cells if any(cell in tests for tests in of_keys.values())]
        if not cells:
            return None
        key, ties = place.key, self._ties(place.key, cells, of_keys)
        if ties and min(ties.values()) < -INDISTINGUISHABLE_LOSS:
            key = min(ties, key=lambda other: ties[other])
            ties = self._ties(key, cells, of_keys)
        tests = of_keys[key]
        cells = [cell for cell in cells if cell in tests]
        whole = together(tests, cells)
        around = {(cell, key) for cell in _near(tests, place.cells)}
        tail = self._tail(tests, around, self._keys.index(key))
        whole = replace(whole, freedom=min(whole.freedom, tail))
        if (
            not cells
            or (p := p_value(whole)) >= self._significance
            or not is_claimable(key, whole)
        ):
            return None
        # One that failed in a later pass has passed there as well.
        recordings = self._passing(cells).union(place.recordings)
        return replace(
            place, key=key, size=whole.size, deviation=deviation_of(tests, cells),
            freedom=whole.freedom, p_value=p, recordings=tuple(sorted(recordings)),
            alternatives=tuple(ties),
        )  # fmt: skip

    def _ties(
        self, key: str, cells: Sequence[Cell], tests: Mapping[str, Mapping[Cell, CellTest]]
    ) -> dict[str, float]:
        """
        Return the other effects that explain cells about as well, or better.

        Effect -> twice the logarithm of the odds against it.
        """
        gain = evidence(key, cells, tests, self._cells)
        odds = {x: gain - evidence(x, cells, tests, self._cells) for x in tests if x != key}
        return {
            other: against
            for other, against in odds.items()
            if against < INDISTINGUISHABLE_LOSS
            and is_claimable(other, together(tests[other], cells))
        }

    def _passing(self, cells: Sequence[Cell]) -> set[str]:
        """Return the names of the recordings that pass any of these cells."""
        return {self._names[r] for cell in cells for r in self._cells[cell].recordings}

    def _tail(
        self, tests: Mapping[Cell, CellTest], blocked: Collection[tuple[Cell, str]], k: int
    ) -> float:
        """
        Return the tail of the sizes of parameter `k` where nothing acts.

        Without the cells `blocked`, and those that something may act at, by tests without a tail.
        """
        shown = [cell for cell, test in tests.items() if p_value(test) < self._significance]
        left_out = {cell for cell, key in blocked if key == self._keys[k]} | _near(tests, shown)
        return tail_of([test for cell, test in tests.items() if cell not in left_out])

    def _tests_of(self, k: int, scores: Mapping[Cell, FloatArray]) -> dict[Cell, CellTest]:
        """Return the size of a parameter at each cell against the empirical null."""
        tests = {
            cell: cell_test(scores[cell][:, k], visits.informations[:, k, k])
            for cell, visits in self._cells.items()
        }
        null = null_of(list(tests.values()))
        found = {}
        for cell, test in tests.items():
            if test.variance > 0.0:
                size = test.size - null.centre
                inexact = SYSTEMATIC_ERROR_PER_MATERIALITY**2
                inexact += (SYSTEMATIC_ERROR_SHARE * size) ** 2
                variance = null.inflation * test.variance + null.spread + inexact
                found[cell] = CellTest(size, variance, test.freedom)
        return found

    def _around(self, place: Place) -> set[tuple[Cell, str]]:
        """
        Return (cell, key) of the cells of a place and around it, for all parameters.

        What one size leaves there is no second effect: the place begins and ends within a cell,
        its linearisation is not exact, and its residuals last for a block.
        """
        around = {c for c in self._cells if any(_is_near(c, cell) for cell in place.cells)}
        return {(cell, key) for cell in around for key in self._keys}

    def _best(
        self,
        scores: Mapping[Cell, FloatArray],
        blocked: set[tuple[Cell, str]],
    ) -> Place | None:
        """Return the place of the most significant cell, all tests against the null."""
        tests: dict[str, dict[Cell, CellTest]] = {}
        for k, key in enumerate(self._keys):
            against_noise = self._tests_of(k, scores)
            tail = self._tail(against_noise, blocked, k)
            tests[key] = {
                cell: replace(test, freedom=min(test.freedom, tail))
                for cell, test in against_noise.items()
            }
        good = {
            (cell, key): test
            for key, of_key in tests.items()
            for cell, test in of_key.items()
            if p_value(test) < self._significance
            and (cell, key) not in blocked
            and is_claimable(key, test)
        }
        if not good:
            return None
        seed, found = min(good, key=lambda pair: _rank(good[pair]))
        # Each effect in the cells that show it; in one cell alone if its mean there is impossible.
        shown = {
            key: cells
            for key in self._keys
            if (cells := _cells_that_show(key, seed, tests[key], self._significance, blocked))
            and is_claimable(key, together(tests[key], cells))
        } or {found: [seed]}
        key = max(shown, key=lambda one: evidence(one, shown[one], tests, self._cells))
        cells = shown[key]
        whole = together(tests[key], cells)
        return Place(
            key,
            tuple(sorted(cells, key=lambda c: (c.x, c.y, c.direction))),
            whole.size,
            deviation_of(tests[key], cells),
            whole.freedom,
            p_value(good[seed, found]),
            tuple(sorted(self._passing(cells))),
            tuple(self._ties(key, cells, tests)),
        )


def _cells_that_show(
    key: str,
    seed: Cell,
    tests: Mapping[Cell, CellTest],
    significance: float,
    blocked: set[tuple[Cell, str]],
) -> list[Cell]:
    """
    Return the connected cells that show an effect of one sign, none if the seed does not.

    Within reach of the seed those whose single test shows it, beyond it the significant ones.
    """
    start = tests.get(seed)
    if start is None or p_value(start) >= _SHOWS or not is_claimable(key, start):
        return []
    shown = {
        cell
        for cell, test in tests.items()
        if (cell, key) not in blocked
        and np.sign(test.size) == np.sign(start.size)
        and is_claimable(key, test)
        and p_value(test) < (_SHOWS if _is_near(cell, seed) else significance)
    }
    return _connected(seed, shown) if seed in shown else []


def _near(cells: Iterable[Cell], place: Sequence[Cell]) -> set[Cell]:
    """Return the cells within reach of a place."""
    return {cell for cell in cells if any(_is_near(cell, other) for other in place)}


def _rank(test: CellTest) -> tuple[float, float]:
    """Return what the most significant test has the least of; many p-values may be zero."""
    return p_value(test), -test.gain


def _is_near(cell: Cell, other: Cell) -> bool:
    """Whether a block of residuals may reach from one cell to the other, in any direction."""
    return max(abs(cell.x - other.x), abs(cell.y - other.y)) <= _REACH


def _connected(seed: Cell, cells: set[Cell]) -> list[Cell]:
    """Return the cells that adjoin the seed, directly or through others."""
    found, front = {seed}, [seed]
    while front:
        here = front.pop()
        new = {cell for cell in cells - found if cell.is_next_to(here)}
        found |= new
        front += new
    return list(found)
