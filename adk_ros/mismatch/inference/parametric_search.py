# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Search for features with a memory, a threshold, wear or an oscillation.

All members of a grid are screened by their linear response (`linear_response`); the parameters of
the best are refined. A feature that was found by a search costs `PENALTY_PER_LOCATION` for each
parameter that was searched.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from adk_ros.mismatch.inference.found_feature import Found
from adk_ros.mismatch.inference.linear_response import LinearResponse
from adk_ros.mismatch.inference.parametric_grid import ParametricGrid
from adk_ros.mismatch.inference.periodic_search import PeriodicSearch
from adk_ros.mismatch.library.criteria import PENALTY_PER_LOCATION
from adk_ros.mismatch.library.features import Signals, feature
from adk_ros.mismatch.library.parametric_features import (
    DECAY,
    DRIFT,
    GATE,
    kind_of,
    searched_parameters,
    split_condition,
)
from adk_ros.numerics.arrays import FloatArray

_KEPT = 20
"""Members of the grid, of each equation, that are kept for later rounds. By choice."""
_REFINED = 6
"""Members that are refined in each round."""


class ParametricSearch:
    """Parametric features along a recording; a part of the grid is kept after the first round."""

    def __init__(self, signals: Signals, equations: Sequence[str], features: Sequence[str]):
        """`features`: the observable ones; others are neither modified nor conditions."""
        self.signals = signals
        self.grid = ParametricGrid(signals, features)
        self._periodic = PeriodicSearch(signals, equations, features)
        self._pairs = [(name, e) for name in self.grid.names for e in equations]

    def best(self, response: LinearResponse, count: int) -> list[Found]:
        """Return the best features, their parameters refined, best first."""
        found = []
        for name, pairs in groupby(self._pairs, key=lambda pair: pair[0]):
            values = self.values(name)
            found += [_screened(response, equation, name, values) for _, equation in pairs]
        found.sort(key=lambda x: -x.gain)
        distinct = _distinct(found)
        # Neighbours of the best one would take the place of all other kinds, and its equation that
        # of the others. Members of one name stay together: its values are computed once.
        self._pairs = sorted(
            (x.name, x.equation)
            for equation in {x.equation for x in distinct}
            for x in [one for one in distinct if one.equation == equation][:_KEPT]
        )
        refined = [self._refined(response, x) for x in distinct[:_REFINED]]
        refined += self._periodic.best(response)
        return sorted(refined, key=lambda x: -x.gain)[:count]

    def values(self, name: str) -> FloatArray:
        """Return a feature along the recording (n,)."""
        return feature(name).function(self.signals)

    def _refined(self, response: LinearResponse, start: Found) -> Found:
        """Return the best feature of the same kind with parameters near those of `start`."""
        best = start
        for spacing in (1.0, 0.3):
            trials = [
                _screened(response, best.equation, name, self.values(name))
                for name in self.grid.neighbours(best.name, spacing)
            ]
            best = max([best, *trials], key=lambda x: x.gain)
        return best


def _screened(response: LinearResponse, equation: str, name: str, values: FloatArray) -> Found:
    if not np.any(values):
        return Found(equation, name, -np.inf)
    _, gain = response.gain(response.column(equation, values)[:, None])
    return Found(equation, name, gain - PENALTY_PER_LOCATION * searched_parameters(name))


def _distinct(found: Sequence[Found]) -> list[Found]:
    """Return the best feature of each equation, kind and signal, and condition or variable."""
    seen: dict[tuple[str, ...], Found] = {}
    for item in found:
        arguments = item.name.split(":")
        key = [item.equation, *arguments[:2]]
        if kind_of(item.name) == GATE:
            key.append(split_condition(arguments[2])[0])
        elif kind_of(item.name) in {DRIFT, DECAY}:
            key.append(arguments[2])
        seen.setdefault(tuple(key), item)
    return list(seen.values())
