# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Effects at places, from rows drawn without any simulation."""

from __future__ import annotations

import numpy as np

from adk_ros.fleet.inference.evidence import SCHEMA, Row, packed
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.fleet.inference.places import Place, PlaceData

KEY, CELLS, RECORDINGS, SIGNIFICANCE = "road_bank.bank", 40, 20, 1e-5
NAMES = [f"drive{i}" for i in range(RECORDINGS)]


def _rows(
    surrogate_error: float, size: float = 0.0, seed: int = 1, last: tuple[int, int] = (20, 20)
) -> list[Row]:
    """
    Return rows of cells along a line, with an effect of `size` in the cells `last`.

    The surrogate's error repeats on every recording: it is a score of `surrogate_error` standard
    deviations of that of noise, the same on each of them.
    """
    rng = np.random.default_rng(seed)
    rows: list[Row] = []
    for x in range(CELLS):
        # Cells are apart, but for those of the place.
        cell = Cell(x if last[0] <= x <= last[1] else 100 + 3 * x, 0, 0)
        # Some cells inform a hundred times less than others.
        information = 10.0 ** (rng.uniform(0.0, 2.0) if size == 0.0 else 2.0)
        acts = size if last[0] <= x <= last[1] else 0.0
        feigned = surrogate_error * np.sqrt(information) * rng.standard_normal()
        for name in NAMES:
            noise = np.sqrt(information) * rng.standard_normal()
            rows.append(
                {
                    "schema": SCHEMA,
                    "kind": "place",
                    "recording": name,
                    "cell": cell.text,
                    "counted_s": 4.0,
                    "effects": KEY,
                    "score": packed(np.array([information * acts + feigned + noise])),
                    "information": packed(np.array([[information]])),
                    "cross": np.zeros((1, 2), dtype="<f4").tobytes(),
                }
            )
    return rows


def _found(rows: list[Row]) -> list[Place]:
    data = PlaceData(rows, NAMES, dict.fromkeys(NAMES, 1.0))
    return data.select(np.zeros((RECORDINGS, 2)), SIGNIFICANCE)


def test_an_effect_at_a_place_is_found_with_its_cells() -> None:
    (place,) = _found(_rows(0.3, size=6.0, last=(20, 22)))
    assert {cell.x for cell in place.cells} == {20, 21, 22}
    assert place.interval[0] < 6.0 < place.interval[1]


def test_an_error_that_repeats_is_no_place_even_where_little_informs() -> None:
    # Each cell shows several deviations of noise, and poor ones a size of many thresholds.
    for seed in range(20):
        assert _found(_rows(2.0, seed=seed)) == []


def test_what_a_known_place_leaves_next_to_it_is_no_second_one() -> None:
    rows = _rows(0.3, size=6.0, last=(20, 22))
    data = PlaceData(rows, NAMES, dict.fromkeys(NAMES, 1.0))
    at = np.zeros((RECORDINGS, 2))
    known = Place(KEY, (Cell(20, 0, 0),), 0.0, 1.0, 9.0, 1e-9, RECORDINGS)
    places = data.select(at, SIGNIFICANCE, [known])
    assert [place.cells for place in places[:1]] == [known.cells]
    assert all(Cell(21, 0, 0) not in place.cells for place in places)
