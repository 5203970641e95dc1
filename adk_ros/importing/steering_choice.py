# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Choose unit and ratio of the steering angle: angle = ratio * L * yaw rate / v_x."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from adk_ros.importing.relations import relation
from adk_ros.importing.unit_choice import Findings
from adk_ros.importing.units import factor_to_si
from adk_ros.numerics.arrays import FloatArray

_MIN_SPEED = 0.15
"""Share of the top speed above which steering is compared with the curvature."""
_WHEELBASE = 2.8
"""m; of a passenger car, to estimate the ratio of a hand wheel."""
_WHEELBASES = (0.2, 6.0)
_HAND_WHEEL_RATIOS = (8.0, 30.0)


def choose_steering(
    signals: Mapping[str, FloatArray],
    known: Mapping[str, str],
    is_hand_wheel: bool | None,
    found: Findings,
) -> None:
    """Choose unit and ratio of the steering angle, from angle * v_x = L * ratio * yaw rate."""
    units = (known["delta"],) if "delta" in known else ("rad", "deg")
    size = float(np.quantile(np.abs(signals["delta"]), 0.99))
    guess = units[0] if len(units) == 1 else ("deg" if size > 1.6 else "rad")
    found.units.setdefault("delta", guess)
    found.reasons["delta"] = f"size of the values, up to {size:.3g}"
    v, rate = signals.get("v_x"), signals.get("yaw_rate")
    if v is None or rate is None:
        found.ratio = 15.0 if is_hand_wheel else 1.0
        found.ratio_reason = "no v_x and yaw rate to compare with"
        return
    speed = v * factor_to_si(known.get("v_x", found.units.get("v_x", "m/s")), "m/s")
    turn = rate * factor_to_si(
        known.get("yaw_rate", found.units.get("yaw_rate", "rad/s")), "rad/s"
    )
    moving = np.abs(speed) > _MIN_SPEED * np.abs(speed).max()
    # At small lateral acceleration, understeer hardly enters.
    moving &= np.abs(speed * turn) < max(float(np.quantile(np.abs(speed * turn), 0.8)), 0.5)
    held = relation(signals["delta"][moving], turn[moving] / speed[moving], "delta", (), "")
    if not held.is_useful:
        found.ratio = 15.0 if is_hand_wheel else 1.0
        found.ratio_reason = "too little steering to compare with the yaw rate"
        return
    fits = []
    for unit in units:
        length = abs(held.ratio) * factor_to_si(unit, "rad")
        if _WHEELBASES[0] <= length <= _WHEELBASES[1] and is_hand_wheel is not True:
            fits.append((abs(math.log(length / _WHEELBASE)), unit, 1.0, length))
        ratio = length / _WHEELBASE
        if _HAND_WHEEL_RATIOS[0] <= ratio <= _HAND_WHEEL_RATIOS[1] and is_hand_wheel is not False:
            fits.append((abs(math.log(ratio / 15.0)) + 0.1, unit, ratio, _WHEELBASE))
    if not fits:
        length = abs(held.ratio) * factor_to_si(guess, "rad")
        found.ratio = 15.0 if is_hand_wheel else 1.0
        found.ratio_reason = f"angle / curvature = {length:.3g} m fits no wheelbase and ratio"
        return
    _, unit, ratio, length = min(fits)
    found.units["delta"] = unit
    found.reasons["delta"] = (
        f"angle / curvature of the path (correlation {abs(held.correlation):.2f})"
    )
    if len(fits) == 1:
        found.certain.add("delta")
    found.ratio = float(f"{ratio:.3g}")
    if ratio == 1.0:
        found.ratio_reason = f"road wheel: fits a wheelbase of {length:.2g} m"
        found.is_ratio_certain = len(fits) == 1
    else:
        found.ratio_reason = f"hand wheel: for a wheelbase of {_WHEELBASE} m; see the data sheet"
