# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scale of the odometry, scale and bias of yaw rates: changes over blocks of 5 s.

Over a block the integral of a rate is compared with the change of what it is the rate of. A delay
or a low-pass filter of the rate changes that integral only by its lag times the change of the
rate between the ends of the block, which is a column of the regression: neither is mistaken for a
scale, as a regression of rate on rate would.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from adk_ros.calibration.criteria import BLOCK_S, MIN_SPEED_CHANGE, PERIOD_S
from adk_ros.calibration.finding import Finding, Verdict, judged, not_decidable, undecided
from adk_ros.calibration.grid import Signals
from adk_ros.calibration.regression import Regression, regress
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.similarity import time_scale

_MIN_COSINE = 0.85
"""Cosine of 32°, the steepest bank of an oval (Talladega: 33°)."""


def check_odometry_scale(s: Signals, size: float = 1.0) -> Iterator[Finding]:
    """
    Yield the scale of v_x against the pose, and against the accelerometer.

    :param size: scale of the car's lengths (`numerics.similarity`).
    """
    if s.v_x is None:
        return
    by_pose = _scale_by_pose(s)
    yield by_pose
    yield _scale_by_acceleration(s, by_pose.verdict is Verdict.OK, size)


def check_yaw_rates(s: Signals) -> Iterator[Finding]:
    """Yield scale and bias of the gyro, and of odometry's yaw rate where a pose exists."""
    if s.heading is not None:
        other = s.gyro if s.gyro is not None else s.yaw_rate
        if s.gyro is not None:
            yield from _rate(s, s.gyro, s.heading, s.yaw_rate, "gyro", "heading of the pose")
        if s.yaw_rate is not None:
            yield from _rate(s, s.yaw_rate, s.heading, other, "yaw_rate", "heading of the pose")
    elif s.gyro is not None and s.yaw_rate is not None:
        integral = np.cumsum(s.yaw_rate) * PERIOD_S
        yield from _rate(s, s.gyro, integral, None, "gyro", "integral of odometry's yaw rate")


def _scale_by_pose(s: Signals) -> Finding:
    name = "odometry_scale"
    compared = distances(s)
    if compared is None:
        return not_decidable(name, "odometry has no pose")
    columns, driven, weights, period_s = compared
    found = regress(columns, driven, weights, period_s=period_s)
    evidence = "distance driven by v_x, v_y over 5 s against the displacement of the pose"
    if found is None:
        return not_decidable(name, _too_little(s), evidence)
    text = "odometry's velocity is not to the scale of its position: ratio"
    scale = found.estimate(0)
    return judged(name, scale, 1.0, text, evidence, parameters={name: scale.value})


def distances(
    s: Signals, block_s: float = BLOCK_S
) -> tuple[FloatArray, FloatArray, FloatArray, float] | None:
    """
    Return columns (b, 2), target (b,) and weights (b,) of the scale, and the length of a block, s.

    The target is the distance driven by v_x, v_y in a block; the columns are the displacement of
    the pose and the change of v_x, which takes up a delay. None without a pose.
    """
    if s.v_x is None or s.forward is None or s.heading is None or s.x is None or s.y is None:
        return None
    left = s.v_y if s.v_y is not None else np.zeros_like(s.v_x)
    c, n = np.cos(s.heading), np.sin(s.heading)
    starts, weights = blocks_of(s, block_s)
    driven = np.hypot(
        integral_over(s.v_x * c - left * n, starts, block_s),
        integral_over(s.v_x * n + left * c, starts, block_s),
    )
    # Straight-line distances: a constant error of the heading turns both by the same angle.
    moved = np.hypot(change_over(s.x, starts, block_s), change_over(s.y, starts, block_s))
    ends = change_over(s.v_x, starts, block_s)
    return np.column_stack([moved, ends]), driven, weights, block_s


def _scale_by_acceleration(s: Signals, is_speed_right: bool, size: float) -> Finding:
    name = "acceleration_scale"
    if s.a is None or s.longitudinal is None:
        return not_decidable(name, "the recording has no accelerometer or no velocity")
    assert s.v_x is not None
    starts, weights = blocks_of(s)
    change = change_over(s.v_x, starts)
    usual = float(np.sqrt(weights @ change**2 / max(float(weights.sum()), 1.0)))
    if usual < MIN_SPEED_CHANGE * time_scale(size):
        reason = f"the speed changes by {usual:.2f} m/s (RMS) in {BLOCK_S:g} s only"
        return not_decidable(name, reason)
    coupling = integral_over(s.longitudinal - np.gradient(s.v_x, PERIOD_S), starts)
    sensed = integral_over(s.a[0], starts)
    columns = np.column_stack([change + coupling, np.full_like(change, BLOCK_S)])
    found = regress(columns, sensed, weights, period_s=BLOCK_S)
    evidence = "integral of a_x over 5 s against the change of v_x"
    if found is None:
        return not_decidable(name, _too_little(s), evidence)
    text = "the accelerometer's a_x is not to the scale of odometry's v_x: ratio"
    scale = found.estimate(0)
    proposal = {"accelerometer_scale": scale.value} if is_speed_right else {}
    remedy = "which of both is wrong is not known: odometry has no pose that confirms its scale"
    return judged(name, scale, 1.0, text, evidence, parameters=proposal, remedy=remedy)


def _rate(
    s: Signals,
    rate: FloatArray,
    angle: FloatArray,
    instrument: FloatArray | None,
    name: str,
    reference: str,
) -> Iterator[Finding]:
    """Yield scale and bias of a rate against the change of an angle."""
    starts, weights = blocks_of(s)
    change, ends = change_over(angle, starts), change_over(rate, starts)
    duration = np.full_like(change, BLOCK_S)
    columns = np.column_stack([change, duration, ends])
    instruments = columns
    if instrument is not None:
        # The noise of the heading would lower the scale; another sensor's noise is independent.
        instruments = np.column_stack([integral_over(instrument, starts), duration, ends])
    found: Regression | None = regress(
        columns, integral_over(rate, starts), weights, instruments, period_s=BLOCK_S
    )
    title = "the gyro" if name == "gyro" else "odometry's yaw rate"
    evidence = (
        f"integral of {title} over 5 s against the change of the {reference}, with a column that "
        "takes up delay and filter"
    )
    if found is None:
        yield not_decidable(f"{name}_scale", _too_little(s), evidence)
        return
    text = f"{title} is not to the scale of the {reference}: ratio"
    scale, bias = found.estimate(0), found.estimate(1)
    # Without a pose, the other yaw rate may as well be the wrong one.
    has_reference = s.heading is not None
    remedy = "which of both is wrong is not known: odometry has no pose"
    proposal = {f"{name}_scale": scale.value} if has_reference else {}
    of_scale = judged(
        f"{name}_scale", scale, 1.0, text, evidence,
        kind="gyro_scale", parameters=proposal, remedy=remedy,
    )  # fmt: skip
    yield _unless_banked(of_scale, s)
    text = f"{title} has a bias against the {reference}"
    proposal = {f"{name}_bias": bias.value / scale.value} if has_reference else {}
    yield judged(
        f"{name}_bias", bias, 0.0, text, evidence,
        kind="gyro_bias", parameters=proposal, remedy=remedy,
    )  # fmt: skip


def _unless_banked(scale: Finding, s: Signals) -> Finding:
    """
    Return the finding on the scale of a yaw rate, undecided where banked bends explain it.

    About the vertical axis of a car that is rolled by a bank, the yaw rate is the cosine of the
    bank times the rate of the heading. A bank also lowers the lateral specific force, by g times
    its sine; where that is measured and not seen, the bends are level.
    """
    value = scale.value
    if scale.verdict is not Verdict.FINDING or value is None or not _MIN_COSINE < value < 1.0:
        return scale
    bank = float(np.arccos(value))
    reason = f"bends banked by {np.degrees(bank):.0f}° would lower the yaw rate as much"
    if s.a is None or s.lateral is None:
        return undecided(scale, f"{reason}, and there is no accelerometer to see it")
    columns = np.column_stack([s.lateral, np.ones_like(s.lateral)])
    fit = regress(columns, s.a[1], s.moving)
    bends = s.moving * np.abs(s.lateral)
    usual = float(bends @ np.abs(s.lateral)) / max(float(bends.sum()), 1e-9)
    lowered = GRAVITY * float(np.sin(bank)) / max(usual, 1e-9)
    if fit is not None and fit.estimate(0).low > 1.0 - 0.5 * lowered:
        return scale
    return undecided(scale, reason)


def blocks_of(
    s: Signals, block_s: float = BLOCK_S, usable: FloatArray | None = None
) -> tuple[IntArray, FloatArray]:
    """
    Return the first rows of consecutive blocks, and weights: 1 if all of a block counts.

    :param usable: weights (n,) of the samples; default: those of the signals.
    """
    weights = s.moving if usable is None else usable
    rows = round(block_s / PERIOD_S)
    starts = np.arange(0, s.at_s.size - rows, rows, dtype=np.int64)
    sums = np.concatenate([[0.0], np.cumsum(weights)])
    whole = sums[starts + rows] - sums[starts] > rows - 0.5
    return starts, whole.astype(np.float64)


def integral_over(values: FloatArray, starts: IntArray, block_s: float = BLOCK_S) -> FloatArray:
    """Return the integral (b,) of values over each block, by the trapezoidal rule."""
    steps = 0.5 * PERIOD_S * (values[1:] + values[:-1])
    total = np.concatenate([[0.0], np.cumsum(steps)])
    return change_over(total, starts, block_s)


def change_over(values: FloatArray, starts: IntArray, block_s: float = BLOCK_S) -> FloatArray:
    """Return the change (b,) of values over each block."""
    rows = round(block_s / PERIOD_S)
    return np.asarray(values[starts + rows] - values[starts])


def _too_little(s: Signals) -> str:
    return f"{s.moving_s:.0f} s of driving without faults are too few"
