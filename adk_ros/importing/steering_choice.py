# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Choose unit and ratio of the steering angle: angle = ratio * L * yaw rate / v_x."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product
from typing import NamedTuple

import numpy as np

from adk_ros.importing.relations import Relation, relation
from adk_ros.importing.unit_choice import Findings
from adk_ros.importing.units import factor_to_si
from adk_ros.numerics.arrays import FloatArray

_MIN_SPEED = 0.15
"""Share of the top speed above which steering is compared with the curvature."""
_WHEELBASE = 2.8
"""m; of a passenger car, to estimate the ratio of a hand wheel."""
_WHEELBASES = (0.2, 6.0)
_HAND_WHEEL_RATIOS = (8.0, 30.0)
_USUAL_RATIO = 15.0
_MAX_RADIANS = 1.6
"""rad; no road wheel turns further."""


class _Fit(NamedTuple):
    """Units and ratio with which steering and path agree; `penalty` grows with their oddity."""

    penalty: float
    unit: str
    speed_unit: str
    rate_unit: str
    ratio: float
    wheelbase: float


def choose_steering(
    signals: Mapping[str, FloatArray],
    known: Mapping[str, str],
    is_hand_wheel: bool | None,
    found: Findings,
) -> None:
    """
    Choose unit and ratio of the steering angle, from angle * v_x = L * ratio * yaw rate.

    Where nothing else was clear of the units of v_x and yaw rate, they are chosen as well.
    """
    size = float(np.quantile(np.abs(signals["delta"]), 0.99))
    guess = known.get("delta", "deg" if size > _MAX_RADIANS else "rad")
    found.units.setdefault("delta", guess)
    found.reasons["delta"] = f"size of the values, up to {size:.3g}"
    found.ratio = _USUAL_RATIO if is_hand_wheel else 1.0
    if "v_x" not in signals or "yaw_rate" not in signals:
        found.ratio_reason = "no v_x and yaw rate to compare with"
        return
    fits, held = _fits(signals, known, is_hand_wheel, found)
    if not held.is_useful:
        found.ratio_reason = "too little steering to compare with the yaw rate"
        return
    if not fits:
        found.ratio_reason = "angle / curvature of the path fits no wheelbase and ratio"
        return
    best = min(fits)
    reason = f"angle / curvature of the path (correlation {abs(held.correlation):.2f})"
    for name, unit in (
        ("delta", best.unit), ("v_x", best.speed_unit), ("yaw_rate", best.rate_unit),
    ):  # fmt: skip
        if name not in known and (name == "delta" or unit != found.units.get(name)):
            found.units[name], found.reasons[name] = unit, reason
    if len(fits) == 1:
        found.certain.add("delta")
    found.ratio = float(f"{best.ratio:.3g}")
    if best.ratio == 1.0:
        found.ratio_reason = f"road wheel: fits a wheelbase of {best.wheelbase:.2g} m"
        found.is_ratio_certain = len(fits) == 1
    else:
        found.ratio_reason = f"hand wheel: for a wheelbase of {_WHEELBASE} m; see the data sheet"


def _fits(
    signals: Mapping[str, FloatArray],
    known: Mapping[str, str],
    is_hand_wheel: bool | None,
    found: Findings,
) -> tuple[list[_Fit], Relation]:
    """Return the possible choices, and the relation of steering and path."""
    v, rate = signals["v_x"], signals["yaw_rate"]
    moving = np.abs(v) > _MIN_SPEED * np.abs(v).max()
    # At small lateral acceleration, understeer hardly enters.
    lateral = np.abs(v * rate)
    moving &= lateral <= float(np.quantile(lateral, 0.8))
    held = relation(signals["delta"][moving], rate[moving] / v[moving], "delta", (), "")
    fits: list[_Fit] = []
    if not held.is_useful:
        return fits, held
    choices = product(
        (known["delta"],) if "delta" in known else ("rad", "deg"),
        _possible("v_x", known, found, ("m/s", "km/h")),
        _possible("yaw_rate", known, found, ("rad/s", "deg/s")),
    )
    for unit, speed_unit, rate_unit in choices:
        factor = factor_to_si(unit, "rad") * factor_to_si(speed_unit, "m/s")
        length = abs(held.ratio) * factor / factor_to_si(rate_unit, "rad/s")
        # What the sizes of the values said before is kept if it fits.
        changed = (speed_unit != found.units.get("v_x", speed_unit)) + (
            rate_unit != found.units.get("yaw_rate", rate_unit)
        )
        ratio = length / _WHEELBASE
        if _WHEELBASES[0] <= length <= _WHEELBASES[1] and is_hand_wheel is not True:
            penalty = changed + abs(math.log(ratio))
            fits.append(_Fit(penalty, unit, speed_unit, rate_unit, 1.0, length))
        if _HAND_WHEEL_RATIOS[0] <= ratio <= _HAND_WHEEL_RATIOS[1] and is_hand_wheel is not False:
            penalty = changed + abs(math.log(ratio / _USUAL_RATIO)) + 0.1
            fits.append(_Fit(penalty, unit, speed_unit, rate_unit, ratio, _WHEELBASE))
    return fits, held


def _possible(
    name: str, known: Mapping[str, str], found: Findings, units: tuple[str, ...]
) -> tuple[str, ...]:
    """Return the units that a channel may have: one, if it is stated or clear."""
    if name in known:
        return (known[name],)
    return (found.units[name],) if name in found.certain else units
