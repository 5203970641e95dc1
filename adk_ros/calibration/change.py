# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which single fault makes the calibration of one recording that of another of the same vehicle.

With z the coefficients of all relations (`relations`) and C their covariance, each fault is
removed from the tested recording in the size that minimises

    chi² = sum over relations of d' (f C)^-1 d,   d = z(tested without the fault) - z(reference),

by Gauss-Newton steps. The fault of least chi² is the change; those that a likelihood ratio of
`MAX_ODDS` does not exclude are its other candidates. What no single fault explains is a difference
of the driving or of the road: by the ratio of R. T. Birge (Physical Review 40, 1932, 207) it
widens the covariance of its relation, f = chi² of the relation over its degrees of freedom where
that exceeds 1. A found change is removed, and the search repeated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from adk_ros.calibration.criteria import (
    MAX_LAG_S,
    MAX_ODDS,
    PERIOD_S,
    SAME_COURSE_SHARE,
    SAME_PLACE_S,
    SIGNIFICANCE,
)
from adk_ros.calibration.faults import FAULTS, REFERENCE_WHEELBASE, Fault
from adk_ros.calibration.grid import Signals
from adk_ros.calibration.relations import RelationEstimate, coefficients, relations_of_both
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import QUANTILE_90

MAX_CHANGES = 3
"""Faults that are removed one after another; by choice."""
_ITERATIONS, _TOLERANCE = 8, 0.02
"""Gauss-Newton steps, and the last one in units of the material size."""
_LARGEST_STEP = 10.0
"""Longest step in units of the material size."""
_EVERY = 10
"""Rows between places that are compared: 0.2 s."""
_ROUNDS = 2
"""Passes in which the weights follow from the best explanation of the one before."""


@dataclass(frozen=True)
class FaultFit:
    """
    A fault that was removed: its size with standard error, and the chi² that it leaves.

    `standard_errors`: square root of the chi² that it explains.
    """

    fault: Fault
    size: float
    standard_error: float
    chi2: float
    standard_errors: float
    material: float

    @property
    def half_width(self) -> float:
        """Half of the 90 % interval."""
        return QUANTILE_90 * self.standard_error

    @property
    def change(self) -> float:
        """Size less that of no fault."""
        return self.size - self.fault.nominal

    @property
    def is_change(self) -> bool:
        """Whether the change is significant and material."""
        return self.standard_errors >= SIGNIFICANCE and abs(self.change) >= self.material


@dataclass(frozen=True)
class Change:
    """
    A fault that explains a difference, and those that explain it about as well.

    `is_of_road`: slope or bank of another course does so as well.
    """

    fit: FaultFit
    candidates: tuple[FaultFit, ...]
    is_of_road: bool = False


@dataclass(frozen=True)
class Comparison:
    """
    What has changed between two recordings.

    `changes`: in the order in which they were found. `others`: the remaining faults, with those
    changes removed. `is_same_course`: None without poses. `relations`: names of the relations
    that both recordings have. `missing`: faults that they do not show, for lack of channels or
    length.
    """

    changes: tuple[Change, ...]
    others: tuple[FaultFit, ...]
    relations: tuple[str, ...]
    missing: tuple[Fault, ...]
    is_same_course: bool | None


@dataclass(frozen=True)
class _Evidence:
    """Coefficients of the reference and weights (k, k) of the differences, by relation."""

    reference: Mapping[str, FloatArray]
    weights: Mapping[str, FloatArray]

    def widened(self, factors: Mapping[str, float]) -> _Evidence:
        weights = {name: w / factors[name] for name, w in self.weights.items()}
        return _Evidence(self.reference, weights)

    def chi2(self, values: Mapping[str, FloatArray]) -> dict[str, float]:
        """Return the chi² of each relation."""
        out = {}
        for name, w in self.weights.items():
            d = values[name] - self.reference[name]
            out[name] = float(d @ w @ d)
        return out


@dataclass(frozen=True)
class _Removal:
    """A fault at its best size: coefficients without it, their derivative, and the chi²."""

    fit: FaultFit
    values: dict[str, FloatArray]
    affected: frozenset[str]


def compare(reference: Signals, tested: Signals, wheelbase: float) -> Comparison:
    """
    Return what has changed from one recording to another of the same vehicle.

    :param wheelbase: m; lengths are material in proportion to it.
    """
    known, seen = relations_of_both(reference, tested)
    names = tuple(known)
    evidence = _evidence(known, seen, names)
    faults = [fault for fault in FAULTS if set(fault.needs) & set(names)]
    faults = [fault for fault in faults if _has_channels(fault, tested)]
    is_same_course = same_course(reference, tested)
    changes: list[Change] = []
    while True:
        left = [f for f in faults if f.label not in {c.fit.fault.label for c in changes}]
        fits = _explanations(evidence, tested, left, wheelbase)
        best = min((x for x in fits if x.is_change), key=lambda x: x.chi2, default=None)
        if best is None or len(changes) == MAX_CHANGES:
            break
        limit = best.chi2 + 2.0 * np.log(MAX_ODDS)
        candidates = [
            x for x in fits if x is not best and x.chi2 < limit and x.standard_errors > 0.0
        ]
        is_of_road = best.fault.is_of_road and is_same_course is False
        changes.append(Change(best, tuple(sorted(candidates, key=lambda x: x.chi2)), is_of_road))
        tested = best.fault.remove(tested, best.size)
    missing = tuple(fault for fault in FAULTS if fault not in faults)
    return Comparison(tuple(changes), tuple(fits), names, missing, is_same_course)


def same_course(reference: Signals, tested: Signals) -> bool | None:
    """Return whether a recording stays near the places of another; None without a pose."""
    places = []
    for s in (reference, tested):
        if s.x is None or s.y is None or not s.moving.any():
            return None
        is_moving = s.moving > 0.0
        places.append(np.column_stack([s.x, s.y])[is_moving][::_EVERY])
    steps = np.linalg.norm(np.diff(places[0], axis=0), axis=1)
    near = float(np.median(steps)) * SAME_PLACE_S / (_EVERY * PERIOD_S)
    distance, _ = cKDTree(places[0]).query(places[1])
    return bool(np.mean(distance < near) >= SAME_COURSE_SHARE)


def _has_channels(fault: Fault, s: Signals) -> bool:
    """Whether the fault can be removed, and removing it changes anything."""
    if fault.name == "odometry_filter":
        return s.yaw_rate is not None
    if fault.label in ("imu_bias.gyro", "gyro_scale"):
        return s.gyro is not None
    if fault.name.startswith("imu"):
        return s.a is not None or (fault.name == "imu_delay" and s.gyro is not None)
    return True


def _evidence(
    known: Mapping[str, RelationEstimate],
    seen: Mapping[str, RelationEstimate],
    names: tuple[str, ...],
) -> _Evidence:
    weights = {name: _inverse(known[name].covariance + seen[name].covariance) for name in names}
    return _Evidence({name: known[name].values for name in names}, weights)


def _inverse(covariance: FloatArray) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    inverse = np.linalg.pinv(covariance / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    return np.asarray(inverse / np.outer(scale, scale))


def _explanations(
    evidence: _Evidence, tested: Signals, faults: list[Fault], wheelbase: float
) -> list[FaultFit]:
    """Return each fault in its best size, under weights that the best one leaves consistent."""
    start = {name: coefficients(tested, name) for name in evidence.reference}
    removals: list[_Removal] = []
    weighted = evidence
    for _ in range(_ROUNDS):
        removals = [
            removal
            for fault in faults
            if (removal := _removed(weighted, tested, fault, start, wheelbase)) is not None
        ]
        best = min(removals, key=lambda x: x.fit.chi2, default=None)
        weighted = evidence.widened(_birge(evidence, start, best))
    return [
        removal.fit
        for fault in faults
        if (removal := _removed(weighted, tested, fault, start, wheelbase)) is not None
    ]


def _birge(
    evidence: _Evidence, start: Mapping[str, FloatArray], best: _Removal | None
) -> dict[str, float]:
    """Return the factor on the covariance of each relation."""
    chi2 = evidence.chi2(start if best is None else best.values)
    out = {}
    for name, value in chi2.items():
        freedom = start[name].size - (best is not None and name in best.affected)
        out[name] = max(value / max(freedom, 1), 1.0)
    return out


def _removed(
    evidence: _Evidence,
    tested: Signals,
    fault: Fault,
    start: Mapping[str, FloatArray],
    wheelbase: float,
) -> _Removal | None:
    """Return a fault in the size of least chi²; None if the recording does not show it."""
    material = fault.material * (wheelbase / REFERENCE_WHEELBASE if fault.is_length else 1.0)
    step = 0.5 * material
    size, values = fault.nominal, dict(start)
    affected = [
        name
        for name in start
        if not np.allclose(
            coefficients(fault.remove(tested, size + step), name), start[name], rtol=1e-9, atol=0.0
        )
    ]
    information = 0.0
    for _ in range(_ITERATIONS):
        ahead = fault.remove(tested, size + step)
        gradient, information = 0.0, 0.0
        for name in affected:
            slope = (coefficients(ahead, name) - values[name]) / step
            d = values[name] - evidence.reference[name]
            gradient += float(slope @ evidence.weights[name] @ d)
            information += float(slope @ evidence.weights[name] @ slope)
        if information <= 0.0:
            return None
        move = float(
            np.clip(-gradient / information, -_LARGEST_STEP * material, _LARGEST_STEP * material)
        )
        size += move
        if fault.unit == "s" and abs(size) > MAX_LAG_S:
            return None
        now = fault.remove(tested, size)
        values |= {name: coefficients(now, name) for name in affected}
        if abs(move) < _TOLERANCE * material:
            break
    chi2 = sum(evidence.chi2(values).values())
    explained = sum(evidence.chi2(start).values()) - chi2
    fit = FaultFit(
        fault, size, information**-0.5, chi2, float(np.sqrt(max(explained, 0.0))), material
    )
    return _Removal(fit, values, frozenset(affected))
