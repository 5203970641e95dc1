# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Find the channels whose sign contradicts the others."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from adk_ros.importing.relations import STEP_S, relation
from adk_ros.importing.unit_choice import Findings
from adk_ros.numerics.arrays import FloatArray

_MIN_SPEED = 0.15
"""Share of the top speed above which the path has a direction."""
_STEADY = 0.7
"""
Length of the mean of unit vectors above which angles agree: a standard deviation of 48°, so that
the mean of some seconds is the right one of four directions. By choice.
"""


def choose_signs(signals: Mapping[str, FloatArray], found: Findings) -> None:
    """Find the channels whose sign contradicts the others; the position decides, if there is."""
    v = signals.get("v_x")
    if v is None:
        return
    if float(np.median(v)) < 0.0:
        found.flipped["v_x"] = "most speeds are negative"
        v = -v
    signs: dict[str, int] = {}
    rate = signals.get("yaw_rate")
    if rate is not None:
        for name, signal in (
            ("a_y", signals.get("a_y")),
            ("delta", signals["delta"] * v if "delta" in signals else None),
            (
                "heading",
                np.gradient(signals["heading"], STEP_S) if "heading" in signals else None,
            ),
            ("positions", _turning(signals, v)),
        ):
            if signal is not None:
                target = v * rate if name == "a_y" else rate
                held = relation(signal, target, name, (), "")
                if held.is_useful:
                    signs[name] = 1 if held.correlation > 0.0 else -1
    _flip(signs, found)
    if "heading" in signs and "positions" in signs:
        _align_heading(signals, v, found)
    if (
        "v_y" in signals
        and "yaw_rate" in found.flipped
        and found.flipped.keys() >= set(_turning_ones(signs))
    ):
        # Axes to the right: nothing else says so of v_y.
        found.flipped["v_y"] = "as all others that turn to the left"
        found.doubtful_signs.add("v_y")
    if "a_x" in signals:
        held = relation(signals["a_x"], np.gradient(v, STEP_S), "a_x", (), "")
        if held.is_useful and held.correlation < 0.0:
            found.flipped["a_x"] = "opposite to dv_x/dt"
        if "torque" in signals and held.is_useful:
            drive = relation(signals["torque"], np.gradient(v, STEP_S), "torque", (), "")
            if drive.is_useful and drive.correlation < 0.0:
                found.flipped["torque"] = "opposite to dv_x/dt"


def _turning_ones(signs: Mapping[str, int]) -> list[str]:
    return [name for name in ("a_y", "delta") if name in signs]


def _flip(signs: dict[str, int], found: Findings) -> None:
    """Decide which of the channels that turn with the car have the wrong sign."""
    reference = "positions" if "positions" in signs else "heading" if "heading" in signs else ""
    turning = _turning_ones(signs)
    found.reference = reference
    # Without a reference, two against one.
    is_gyro_wrong = len(turning) == 2 and all(signs[name] < 0 for name in turning)
    if reference:
        is_gyro_wrong = signs[reference] < 0
    if is_gyro_wrong:
        found.flipped["yaw_rate"] = (
            f"opposite to the turning of the {reference}"
            if reference
            else "opposite to all others"
        )
        if not reference:
            found.doubtful_signs.add("yaw_rate")
    for name in turning:
        if (signs[name] < 0) != is_gyro_wrong:
            found.flipped[name] = "opposite to the yaw rate"
            if not reference and len(turning) < 2:
                found.doubtful_signs.add(name)
    if reference == "heading" and is_gyro_wrong:
        # A compass counts clockwise: then the heading is wrong, and the others right.
        found.doubtful_signs |= {name for name in ("yaw_rate", *turning) if name in found.flipped}
        found.reference = ""
    if reference == "positions" and "heading" in signs and (signs["heading"] < 0) != is_gyro_wrong:
        found.flipped["heading"] = "opposite to the turning of the positions"


def _align_heading(signals: Mapping[str, FloatArray], v: FloatArray, found: Findings) -> None:
    """
    Find the right angles by which a heading differs from the course of the positions.

    A compass counts from north, and clockwise: a heading from east, to the left, is 90° minus it.
    """
    path = _course(signals)
    if path is None:
        return
    sign = -1.0 if "heading" in found.flipped else 1.0
    moving = np.abs(v) > _MIN_SPEED * np.abs(v).max()
    heading = signals["heading"]
    # In radians or in degrees, as it is: neither turns at 57 times the rate of the path.
    rates = [float(np.median(np.abs(np.diff(x))[moving[1:]])) for x in (heading, np.unwrap(path))]
    if rates[0] ** 2 > math.degrees(1.0) * rates[1] ** 2:
        heading = np.radians(heading)
    off = np.exp(1j * (path - sign * heading))[moving]
    quarters = round(float(np.angle(off.mean())) / (0.5 * math.pi)) if off.size else 0
    if quarters and abs(off.mean()) > _STEADY:
        found.offsets["heading"] = sign * quarters * 0.5 * math.pi
        found.reasons["heading"] = f"{90 * quarters:+d}° from the course of the positions"
        found.doubtful_signs.add("heading")


def _course(signals: Mapping[str, FloatArray]) -> FloatArray | None:
    """Return the direction of the path from east, to the left, rad; None without positions."""
    if "x" in signals and "y" in signals:
        east, north = signals["x"], signals["y"]
    elif "latitude" in signals and "longitude" in signals:
        north = signals["latitude"]
        east = signals["longitude"] * math.cos(math.radians(float(north.mean())))
    else:
        return None
    return np.asarray(np.arctan2(np.gradient(north), np.gradient(east)))


def _turning(signals: Mapping[str, FloatArray], v: FloatArray) -> FloatArray | None:
    """Return the rate of turning of the path, left positive; None without positions."""
    path = _course(signals)
    if path is None:
        return None
    course = np.unwrap(path)
    moving = np.abs(v) > _MIN_SPEED * np.abs(v).max()
    return np.asarray(np.where(moving, np.gradient(course, STEP_S), 0.0))
