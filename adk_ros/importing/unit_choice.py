# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Choose the units of speed, acceleration and yaw rate that satisfy the relations of a car."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from adk_ros.importing.relations import Relation, relations
from adk_ros.importing.units import factor_to_si
from adk_ros.numerics.arrays import FloatArray

_CLEAR_CORRELATION = 0.85
_MAX_LOG_ERROR = 0.22
"""Deviation of a ratio from 1, as a logarithm, that bank, slope and sideslip explain: 25 %."""
_MIN_MARGIN = 0.25
"""Difference of the sums of deviations by which a choice of units must be the best."""
_MAX_PLAUSIBLE = {"m/s": 110.0, "m/s^2": 40.0, "rad/s": 4.0}
"""Values that a car exceeds at most in spikes."""
_MIN_PLAUSIBLE = {"m/s^2": 0.6, "rad/s": 0.02}
"""Values that a car that is driven exceeds at some time."""
_SPEED_UNITS = ("m/s", "km/h", "mph")

_CANDIDATES = {
    "v_x": _SPEED_UNITS, "gps_speed": _SPEED_UNITS, "acceleration": ("m/s^2", "g"),
    "yaw_rate": ("rad/s", "deg/s"), "heading": ("rad", "deg"), "x": ("m",),
}  # fmt: skip
_SI = {
    "v_x": "m/s", "gps_speed": "m/s", "acceleration": "m/s^2", "yaw_rate": "rad/s",
    "heading": "rad", "x": "m",
}  # fmt: skip
_GROUP = {"a_x": "acceleration", "a_y": "acceleration", "a_z": "acceleration"}


@dataclass
class Findings:
    """
    What consistency says, by channel.

    `units`: the unit that fits; `reasons`: why; `certain`: whether other units are excluded.
    `flipped`: channels whose sign contradicts the others, and why; `doubtful_signs`: those of them
    that may be right. `ratio`: of a hand wheel, 1 of a road wheel, None if nothing is known of
    `delta`. `reference`: what the signs were compared with, empty if only with each other.
    `offsets`: of angles, to be added before the sign, rad.
    """

    units: dict[str, str] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    certain: set[str] = field(default_factory=set)
    flipped: dict[str, str] = field(default_factory=dict)
    doubtful_signs: set[str] = field(default_factory=set)
    ratio: float | None = None
    ratio_reason: str = ""
    is_ratio_certain: bool = False
    reference: str = ""
    offsets: dict[str, float] = field(default_factory=dict)


def choose_units(
    signals: Mapping[str, FloatArray], known: Mapping[str, str], found: Findings
) -> None:
    """Choose the units of speed, acceleration and yaw rate that satisfy the relations best."""
    held = relations(signals)
    present: dict[str, tuple[str, ...]] = {}
    for name in ("v_x", "gps_speed", "yaw_rate", "heading", "x", "a_x", "a_y", "a_z"):
        if name in signals:
            group = _GROUP.get(name, name)
            stated = (known[name],) if name in known else None
            present[group] = stated or present.get(group, _CANDIDATES[group])
    names = list(present)
    scored = []
    for choice in product(*(present[name] for name in names)):
        units = dict(zip(names, choice, strict=True))
        scored.append((_score(units, held, signals), units))
    scored.sort(key=lambda item: item[0])
    best = scored[0][1] if scored else {}
    for name in signals:
        group = _GROUP.get(name, name)
        if group not in best or name in known:
            continue
        found.units[name] = best[group]
        others = [score for score, units in scored if units[group] != best[group]]
        margin = min(others, default=math.inf) - scored[0][0]
        used = [r for r in held if group in {_GROUP.get(x, x) for x in (r.left, *r.right)}]
        errors = [_log_error(r, best) for r in used]
        has_gravity = group == "acceleration" and "a_z" in signals
        clear = [r for r in used if abs(r.correlation) >= _CLEAR_CORRELATION]
        is_certain = margin >= _MIN_MARGIN and bool(clear or has_gravity)
        if is_certain and all(error <= _MAX_LOG_ERROR for error in errors):
            found.certain.add(name)
        found.reasons[name] = _reason(name, used, best, signals)


def _score(
    units: dict[str, str], held: list[Relation], signals: Mapping[str, FloatArray]
) -> float:
    """Return the sum of deviations from the relations, and of implausible sizes."""
    # Beyond a factor of 2, more does not make a choice more wrong.
    total = sum(min(_log_error(r, units), 0.7) * abs(r.correlation) for r in held)
    for name, values in signals.items():
        group = _GROUP.get(name, name)
        if group not in units:
            continue
        factor, si = factor_to_si(units[group], _SI[group]), _SI[group]
        size = factor * float(np.quantile(np.abs(values), 0.99))
        if name == "a_z":
            total += min(abs(math.log(max(factor * abs(float(values.mean())), 1e-9) / 9.81)), 2.0)
        elif si in _MAX_PLAUSIBLE and size > _MAX_PLAUSIBLE[si]:
            total += 2.0
        elif size < _MIN_PLAUSIBLE.get(si, 0.0):
            total += 0.3
    return total


def _log_error(relation: Relation, units: dict[str, str]) -> float:
    """Return the deviation of a relation's ratio from 1 with these units, as a logarithm."""
    left = _GROUP.get(relation.left, relation.left)
    ratio = abs(relation.ratio) * factor_to_si(units[left], _SI[left])
    for name in relation.right:
        ratio /= factor_to_si(units[name], _SI[name])
    return abs(math.log(max(ratio, 1e-12)))


def _reason(
    name: str,
    used: list[Relation],
    units: dict[str, str],
    signals: Mapping[str, FloatArray],
) -> str:
    # A relation of the channel itself says more than one of a channel in the same unit.
    direct = [r for r in used if name in {r.left, *r.right}]
    if direct or used:
        best = max(direct or used, key=lambda r: abs(r.correlation))
        within = 100.0 * (math.exp(_log_error(best, units)) - 1.0)
        return f"{best.text} within {within:.0f} % (correlation {abs(best.correlation):.2f})"
    low, high = np.quantile(signals[name], [0.01, 0.99])
    return f"size of the values, {low:.3g} to {high:.3g}"
