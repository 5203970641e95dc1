# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Missing and repeated readings: gaps, frozen stretches, pose jumps.

With p the share of messages that equal the one before, a sensor of coarse resolution repeats a
reading k times somewhere in n messages with a probability of at most n p^k; a frozen stretch is
longer than that, and longer than `FROZEN_S`.
"""

from __future__ import annotations

import numpy as np

from adk_ros.calibration.criteria import (
    FROZEN_CHANCE,
    FROZEN_S,
    JUMP_ANGLE,
    JUMP_DISTANCE,
    JUMP_SIGMAS,
    MIN_GAP_PERIODS,
    MIN_GAP_S,
)
from adk_ros.calibration.grid import slowest_driving
from adk_ros.calibration.streams import Stream
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.similarity import time_scale
from adk_ros.signals.moving_speed import MIN_SPEED

Interval = tuple[float, float]
"""Begin and end, s."""


def gaps(stream: Stream) -> list[Interval]:
    """Return the intervals without messages."""
    between = np.diff(stream.at_s)
    long = between > max(MIN_GAP_S, MIN_GAP_PERIODS * stream.period_s)
    return [
        (float(stream.at_s[i]), float(stream.at_s[i + 1])) for i in np.flatnonzero(long).tolist()
    ]


def frozen(stream: Stream, speed: FloatArray) -> list[Interval]:
    """
    Return the intervals in which a stream repeats its readings although the car moves.

    :param speed: speed (n,) at the stamps of the stream, m/s.
    """
    varying = [values for name, values in stream.columns.items() if stream.has(name)]
    if not varying:
        return []
    equal = np.ones(stream.at_s.size, dtype=bool)
    equal[0] = False
    for values in varying:
        equal[1:] &= np.diff(values) == 0.0
    equal &= speed > slowest_driving(speed)
    p = float(equal.mean())
    if not 0.0 < p < 1.0:
        return []
    # A long frozen stretch raises p itself; half of the repeated readings are taken as chance.
    longest = np.log(FROZEN_CHANCE / equal.size) / np.log(min(p, 0.5))
    return [
        (begin, end)
        for begin, end, count in runs(stream.at_s, equal)
        if count > longest and end - begin >= FROZEN_S
    ]


def runs(at_s: FloatArray, inside: BoolArray) -> list[tuple[float, float, int]]:
    """Return (begin, end, messages) of the runs in `inside` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    return [
        (float(at_s[max(a - 1, 0)]), float(at_s[b - 1]), int(b - a))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def pose_jumps(
    odometry: Stream, unusable: list[Interval] | None = None, size: float = 1.0
) -> list[tuple[float, float, float]]:
    """
    Return (time in s, distance in m, angle in rad) of pose steps that the motion cannot explain.

    The step expected between two messages is that of the twist. Steps within `unusable` intervals,
    and of a car that manoeuvres, do not count: at walking pace a heading that follows the course
    turns by itself.

    :param size: scale of the car's lengths (`numerics.similarity`), by which a jump is shorter and
        walking pace slower.
    """
    at = odometry.at_s
    elapsed = np.diff(at)
    usual = elapsed < max(MIN_GAP_S, MIN_GAP_PERIODS * odometry.period_s)
    for begin, end in unusable or []:
        usual &= (at[1:] < begin) | (at[:-1] > end)

    def between(name: str) -> FloatArray:
        values = np.nan_to_num(odometry[name])
        return np.asarray(0.5 * (values[1:] + values[:-1]) * elapsed)

    heading = odometry["heading"]
    middle = 0.5 * (heading[1:] + heading[:-1])
    ahead, left = between("v_x"), between("v_y")
    c, n = np.cos(middle), np.sin(middle)
    excess = np.hypot(
        np.diff(odometry["x"]) - ahead * c + left * n,
        np.diff(odometry["y"]) - ahead * n - left * c,
    )
    if not odometry.has("heading"):
        # Without a heading, only the length of the step is known.
        moved = np.hypot(np.diff(odometry["x"]), np.diff(odometry["y"]))
        excess = np.abs(moved - np.hypot(ahead, left))
    turn = np.diff(heading) - between("yaw_rate")
    turn = np.arctan2(np.sin(turn), np.cos(turn))
    if not odometry.has("yaw_rate"):
        # How far the car has turned is not known.
        turn = np.zeros_like(turn)
    step = np.hypot(ahead, left)
    usual &= step > MIN_SPEED * time_scale(size) * elapsed
    if not usual.any():
        return []
    far = float(np.median(excess[usual])) + JUMP_SIGMAS * _robust_sigma(excess[usual])
    jump = usual & (
        (excess > max(JUMP_DISTANCE * size, far))
        | (np.abs(turn) > max(JUMP_ANGLE, JUMP_SIGMAS * _robust_sigma(turn[usual])))
    )
    return [
        (float(at[i + 1]), float(excess[i]), abs(float(turn[i])))
        for i in np.flatnonzero(jump).tolist()
    ]


def _robust_sigma(values: FloatArray) -> float:
    """Return 1.48 times the median absolute deviation: the sigma of normal values."""
    if values.size == 0:
        return 0.0
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))
