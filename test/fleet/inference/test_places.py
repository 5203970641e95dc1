# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Effects at places, from rows drawn without any simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from adk_ros.fleet.inference.evidence import SCHEMA, Row, packed
from adk_ros.fleet.inference.place_data import Place, PlaceData
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.fleet.inference.places import select_places

KEY, CELLS, RECORDINGS, SIGNIFICANCE = "road_bank.bank", 40, 20, 1e-5
NAMES = [f"drive{i}" for i in range(RECORDINGS)]


def _rows(
    surrogate_error: float,
    size: float = 0.0,
    seed: int = 1,
    last: tuple[int, int] = (20, 20),
    second: tuple[int, float] | None = None,
    freedom: float = np.inf,
    cells: int = CELLS,
) -> list[Row]:
    """
    Return rows of cells along a line, with an effect of `size` in the cells `last`.

    `second`: a further cell and its size.

    The surrogate's error repeats on every recording: it is a score of `surrogate_error` standard
    deviations of that of noise, the same on each of them, with `freedom` degrees of freedom.
    """
    rng = np.random.default_rng(seed)
    rows: list[Row] = []
    for x in range(cells):
        # Cells are apart, but for those of the place.
        cell = Cell(x if last[0] <= x <= last[1] else 100 + 4 * x, 0, 0)
        if second is not None and x == 0:
            cell = Cell(second[0], 0, 0)
        # Some cells inform a hundred times less than others.
        information = 10.0 ** (rng.uniform(0.0, 2.0) if size == 0.0 else 2.0)
        acts = size if last[0] <= x <= last[1] else 0.0
        if second is not None and x == 0:
            acts = second[1]
        error = rng.standard_normal() if np.isinf(freedom) else rng.standard_t(freedom)
        feigned = surrogate_error * np.sqrt(information) * error
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
                    "cross": np.array([[information, 0.0]], dtype="<f4").tobytes(),
                }
            )
    return rows


def _found(rows: list[Row]) -> list[Place]:
    data = PlaceData(rows, NAMES, dict.fromkeys(NAMES, 1.0))
    return select_places(data, np.zeros((RECORDINGS, 2)), SIGNIFICANCE)


def test_an_effect_at_a_place_is_found_with_its_cells() -> None:
    (place,) = _found(_rows(0.3, size=6.0, last=(20, 22)))
    assert {cell.x for cell in place.cells} == {20, 21, 22}
    assert place.interval[0] < 6.0 < place.interval[1]


def _rows_of_two(
    cells: tuple[int, ...], sizes: dict[int, tuple[float, float]], correlation: float = 0.0
) -> list[Row]:
    """
    Return rows at cells of a line, with the sizes of a bank and a grade in some of them.

    The surrogate's error feigns the bank everywhere, so that its size says little. `correlation`:
    that of the noise in the scores of both.
    """
    feigned = np.array([1.5, 0.1])
    products = np.array([[1.0, correlation], [correlation, 1.0]])
    deviation = np.linalg.cholesky(products)
    rng = np.random.default_rng(1)
    rows: list[Row] = []
    for x in cells:
        everywhere = feigned * rng.standard_normal(2)
        acts = products @ sizes.get(x, (0.0, 0.0))
        for name in NAMES:
            row = {
                "schema": SCHEMA,
                "kind": "place",
                "recording": name,
                "cell": Cell(x, 0, 0).text,
                "counted_s": 4.0,
                "effects": "road_bank.bank,road_grade.grade",
                "score": packed(acts + everywhere + deviation @ rng.standard_normal(2)),
                "information": packed(products),
                "cross": np.zeros((2, 2), dtype="<f4").tobytes(),
            }
            rows.append(row)
    return rows


APART = tuple(range(200, 200 + 5 * CELLS, 5))
"""Cells that do not adjoin."""


def test_the_gain_of_an_effect_is_against_what_the_surrogate_feigns() -> None:
    first = _found(_rows_of_two(APART, {300: (15.0, 6.0)}))[0]
    assert (first.key, first.alternatives) == ("road_grade.grade", ())
    assert first.interval[0] < 6.0 < first.interval[1]


def test_what_a_large_effect_moves_of_another_one_is_not_that_one() -> None:
    """The bank stands out less than the grade, as the surrogate errs in the bank."""
    rows = _rows_of_two((20, *APART), {20: (12.0, 0.0)}, correlation=-0.2)
    (place,) = _found(rows)
    assert (place.key, place.alternatives) == ("road_bank.bank", ())
    assert place.interval[0] < 12.0 < place.interval[1]


def test_an_effect_is_taken_that_the_cells_around_show_as_well() -> None:
    """A bank of four cells, of which none is significant; in one of them a grade would be."""
    sizes = {20: (10.0, 1.9), 21: (10.0, 0.0), 22: (10.0, 0.0), 23: (10.0, 0.0)}
    (place,) = _found(_rows_of_two((20, 21, 22, 23, *APART), sizes))
    assert (place.key, place.alternatives) == ("road_bank.bank", ())
    assert {cell.x for cell in place.cells} == {20, 21, 22, 23}
    assert place.interval[0] < 10.0 < place.interval[1]
    (alone,) = _found(_rows_of_two((20, 21, 22, 23, *APART), {20: (0.0, 1.9)}))
    assert (alone.key, [cell.x for cell in alone.cells]) == ("road_grade.grade", [20])


def test_an_error_that_repeats_is_no_place_even_where_little_informs() -> None:
    # Each cell shows several deviations of noise, and poor ones a size of many thresholds.
    for seed in range(20):
        assert _found(_rows(2.0, seed=seed)) == []


def test_the_largest_of_many_errors_is_no_place() -> None:
    """Errors with heavy tails, in many recordings: the largest is six times as large as usual."""
    every = [_found(_rows(6.0, seed=seed, freedom=3.0, cells=200)) for seed in range(20)]
    # Most of these fleets have a place, if the errors are taken for normal ones.
    assert sum(map(len, every)) <= 3
    (place,) = _found(_rows(0.3, size=60.0, freedom=3.0))
    assert place.size == pytest.approx(60.0, rel=0.1)


@pytest.mark.parametrize("places", [2, 3])
@pytest.mark.parametrize("cells", [40, 60, 100])
def test_places_do_not_hide_each_other(places: int, cells: int) -> None:
    rows = _rows(0.3, cells=cells - 3 * places)
    for i in range(places):
        at = 2000 + 40 * i
        names = {20 + k: f"{at + k}/0/0" for k in range(3)}
        rows += [
            row | {"cell": names[Cell.of_text(str(row["cell"])).x]}
            for row in _rows(0.3, size=6.0, last=(20, 22), seed=i + 2)
            if Cell.of_text(str(row["cell"])).x in names
        ]
    found = _found(rows)
    assert len(found) == places
    assert all(place.size == pytest.approx(6.0, rel=0.2) for place in found)


def test_what_a_known_place_leaves_next_to_it_is_no_second_one() -> None:
    rows = _rows(0.3, size=6.0, last=(20, 22))
    data = PlaceData(rows, NAMES, dict.fromkeys(NAMES, 1.0))
    at = np.zeros((RECORDINGS, 2))
    known = Place(KEY, (Cell(20, 0, 0),), 0.0, 1.0, 9.0, 1e-9, tuple(NAMES))
    places = select_places(data, at, SIGNIFICANCE, [known])
    assert [place.cells for place in places[:1]] == [known.cells]
    assert all(Cell(21, 0, 0) not in place.cells for place in places)


def test_only_what_is_far_from_a_place_is_a_second_one() -> None:
    for x, number in ((25, 1), (26, 2)):
        assert len(_found(_rows(0.3, size=6.0, last=(20, 22), second=(x, -4.0)))) == number


def test_a_size_beyond_its_bounds_is_no_place() -> None:
    # A bank of 6 thresholds is possible, one of 600 is a wall.
    assert len(_found(_rows(0.3, size=6.0))) == 1
    assert _found(_rows(0.3, size=600.0)) == []


def test_a_known_place_has_the_name_of_what_explains_it_now() -> None:
    """It was named a grade before other effects were known, and is linearised there since."""
    rows = _rows_of_two((20, *APART), {20: (12.0, -1.5)}, correlation=-0.2)
    data = PlaceData(rows, NAMES, dict.fromkeys(NAMES, 1.0))
    cell = Cell(20, 0, 0)
    known = Place("road_grade.grade", (cell,), 1.5, 0.1, 9.0, 1e-9, tuple(NAMES))
    (place,) = select_places(data, np.zeros((RECORDINGS, 2)), SIGNIFICANCE, [known])
    assert (place.key, place.cells, place.alternatives) == ("road_bank.bank", (cell,), ())
    assert place.interval[0] < 12.0 < place.interval[1]
    # No recording has evidence of the cell, or of one next to it, by whatever name.
    beside = replace(place, cells=(Cell(21, 0, 1),))
    for one in (place, beside):
        assert not data.correction([one], [known], (RECORDINGS, 2)).any()


def test_a_known_place_that_is_not_seen_any_more_is_dropped() -> None:
    # The recordings were linearised at a size of 3, of which they show nothing.
    rows = _rows(0.3, size=-3.0)
    data = PlaceData(rows, NAMES, dict.fromkeys(NAMES, 1.0))
    known = Place(KEY, (Cell(20, 0, 0),), 3.0, 0.1, 9.0, 1e-9, tuple(NAMES))
    assert select_places(data, np.zeros((RECORDINGS, 2)), SIGNIFICANCE, [known]) == []
    # Recordings have no evidence of known places: nothing is to be undone.
    assert not data.correction([], [known], (RECORDINGS, 2)).any()
    assert not data.saved_loss([], [known], RECORDINGS, np.zeros(2)).any()


def test_what_a_new_place_explains_is_no_evidence_of_anything_else() -> None:
    data = PlaceData(_rows(0.3, size=3.0), NAMES, dict.fromkeys(NAMES, 1.0))
    new = Place(KEY, (Cell(20, 0, 0),), 3.0, 0.1, 9.0, 1e-9, tuple(NAMES))
    np.testing.assert_allclose(data.correction([new], [], (RECORDINGS, 2))[:, 0], 300.0)
    saved = data.saved_loss([new], [], RECORDINGS, np.zeros(2))
    assert (saved > 0.0).all()
    # Recordings count from a joint vector of which one threshold acts at the place as well.
    from_there = data.saved_loss([new], [], RECORDINGS, np.array([1.0, 0.0]))
    np.testing.assert_allclose(from_there, saved - 2.0 * 100.0 * 3.0, rtol=1e-5)
    assert not data.correction([new], [new], (RECORDINGS, 2)).any()
