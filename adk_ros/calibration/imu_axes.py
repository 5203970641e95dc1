# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Axes of the IMU: which of its axes points where, gravity, and units of g.

The specific force of a moving car is known from odometry, dv_x/dt - v_y r ahead and v_x r +
dv_y/dt to the left, and gravity points up through the car: REP-145 wants +9.81 m/s² on z. Of the
48 right- and left-handed assignments of axes the one is taken that correlates best. A
right-handed one that also agrees with the gyro is a turned IMU, a left-handed one a flipped
channel.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product

import numpy as np

from adk_ros.calibration.criteria import (
    MATERIAL,
    MAX_UNIT_ERROR,
    MIN_AXIS_CORRELATION,
    MIN_CORRELATION,
)
from adk_ros.calibration.finding import Finding, found, not_decidable, ok
from adk_ros.calibration.from_bag import turned
from adk_ros.calibration.grid import Signals
from adk_ros.calibration.signs_and_units import gain
from adk_ros.calibration.streams import Streams
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.extrinsics import roll_pitch_yaw
from adk_ros.signals.frames import rotation

AXES = ("a_x", "a_y", "a_z")
_MARGIN = 0.3
"""Sum of the correlations by which another assignment must beat the identity; by choice, a third
of one axis."""
_NOT_REPORTED = 0.05
"""m/s² of a mean a_z below which z carries no gravity at all."""


def assignments() -> list[FloatArray]:
    """Return the 48 matrices (3, 3) that permute and flip axes; the identity is the first."""
    out = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[np.arange(3), order] = signs
            out.append(matrix)
    return out


def check_gravity(streams: Streams, s: Signals) -> tuple[list[Finding], Streams]:
    """Return findings on the unit of the accelerometer and on gravity, and corrected streams."""
    imu = streams.imu
    if imu is None or s.a is None:
        return [not_decidable("gravity", "the recording has no accelerometer")], streams
    mean = float(np.linalg.norm(s.a.mean(axis=1)))
    evidence = f"mean of the acceleration vector: {mean:.3g} m/s² over {s.at_s.size * 0.02:.0f} s"
    if abs(np.log(max(mean, 1e-9))) < MAX_UNIT_ERROR and s.longitudinal is not None:
        # 1 m/s² could be a bias; the gain against odometry decides.
        scales = [
            g
            for values in s.a[:2]
            for reference in (s.longitudinal, s.lateral)
            if reference is not None and (g := gain(values, reference, s.moving)) is not None
        ]
        best = max(scales, key=lambda g: abs(g.correlation), default=None)
        if best is not None and abs(np.log(abs(best.value) * GRAVITY)) < 0.5:
            columns = {name: imu[name] * GRAVITY for name in AXES}
            text = f"the accelerations look like g: the mean vector has a length of {mean:.2f}"
            proposal = {"accelerometer_scale": 1.0 / GRAVITY}
            unit = found("acceleration_unit", text, evidence, proposal)
            return [unit], replace(streams, imu=imu.having(**columns))
    if abs(mean - GRAVITY) < MATERIAL["gravity"].size + 0.02 * GRAVITY:
        return [ok("gravity", f"included, {mean:.2f} m/s²", evidence)], streams
    if mean < 0.3 * GRAVITY:
        text = (
            "gravity is removed or a_z is not reported: a_x and a_y must be specific force "
            "(REP-145), else slope and bank are invisible"
        )
        remedy = "no parameter for this: record the accelerometer without gravity compensation"
        return [found("gravity", text, evidence, remedy=remedy)], streams
    text = f"the mean acceleration is {mean:.2f} m/s², neither gravity nor zero"
    return [found("gravity", text, evidence)], streams


def check_axes(
    streams: Streams, s: Signals, sensors: SensorConfig
) -> tuple[list[Finding], Streams]:
    """Return the findings on the axes of the IMU, and the streams in the axes of the vehicle."""
    imu = streams.imu
    if imu is None or (s.a is None and s.w is None):
        return [], streams
    if s.a is None or s.longitudinal is None or s.lateral is None:
        return [not_decidable("imu_axes", "accelerations and a velocity are needed")], streams
    reference = (s.longitudinal, s.lateral)
    correlation = np.zeros((3, 3))
    for i, expected in enumerate(reference):
        for j in range(3):
            g = gain(s.a[j], expected, s.moving)
            correlation[i, j] = 0.0 if g is None else g.correlation
    mean = s.a.mean(axis=1)
    has_gravity = bool(np.linalg.norm(mean) > 0.3 * GRAVITY)
    if has_gravity:
        correlation[2] = mean / np.linalg.norm(mean)
    known: BoolArray = np.asarray(np.abs(correlation).max(axis=1) >= MIN_AXIS_CORRELATION)
    evidence = (
        "correlation of the axes with dv_x/dt - v_y r, v_x r + dv_y/dt and gravity over "
        f"{s.moving_s:.0f} s"
    )
    if known[:2].sum() == 0 or known.sum() < 2:
        strength = np.abs(correlation[:2]).max()
        reason = f"the accelerations follow the motion with a correlation of {strength:.2f} only"
        return [not_decidable("imu_axes", reason, evidence)], streams
    scores = [float((m * correlation)[known].sum()) for m in assignments()]
    best, score = assignments()[int(np.argmax(scores))], max(scores)
    identity = float(np.trace(correlation[np.ix_(known, known)]))
    if not known.all() or not has_gravity:
        best = _completed(best, known, has_gravity, s)
    if score - identity < _MARGIN or np.array_equal(best, np.eye(3)):
        shown = ", ".join(f"{x:.2f}" for x in np.diag(correlation)[known])
        return [ok("imu_axes", f"x ahead, y left, z up (correlations {shown})", evidence)], streams
    shown = ", ".join(f"{x:.2f}" for x in (best * correlation).sum(axis=1)[known])
    evidence += f": {shown} after the change"
    gyro = _gyro_of(best, s)
    is_rotation = np.linalg.det(best) > 0.0
    if is_rotation and gyro != "disagrees":
        total = best @ rotation(*sensors.imu_rotation)
        angles = [round(angle, 4) + 0.0 for angle in roll_pitch_yaw(total)]
        degrees = ", ".join(f"{np.degrees(a):.0f}" for a in roll_pitch_yaw(best))
        text = f"the IMU is turned by ({degrees})° (roll, pitch, yaw){_upside_down(best)}"
        out = found("imu_axes", text, evidence, {"imu_rotation": angles})
        return [out], replace(streams, imu=turned(imu, best))
    corrected = best @ np.vstack([imu[name] for name in AXES])
    stream = imu.having(**dict(zip(AXES, corrected, strict=True)))
    text = _flipped(best)
    return [found("imu_axes", text, evidence)], replace(streams, imu=stream)


def _completed(best: FloatArray, known: BoolArray, has_gravity: bool, s: Signals) -> FloatArray:
    """Return an assignment whose unknown row follows from the others."""
    out = np.array(best)
    row = int(np.flatnonzero(~known)[0]) if not known.all() else 2
    if not has_gravity and known[:2].all():
        # Without gravity the gyro says which side is up; without a gyro, as it was.
        out[2] = np.cross(out[0], out[1])
        up = _gyro_of(out, s)
        if up == "disagrees":
            out[2] = -out[2]
        return out
    others = [i for i in range(3) if i != row]
    after = (row + 1) % 3, (row + 2) % 3
    if len(others) == 2:
        out[row] = np.cross(out[after[0]], out[after[1]])
    return out


def _gyro_of(matrix: FloatArray, s: Signals) -> str:
    """Return whether the gyro's yaw rate after an assignment agrees with odometry's rotation."""
    reference = s.heading_rate if s.heading_rate is not None else s.yaw_rate
    if s.w is None or reference is None:
        return "unknown"
    g = gain((matrix @ s.w)[2], reference, s.moving)
    if g is None or abs(g.correlation) < MIN_CORRELATION:
        return "unknown"
    return "agrees" if g.correlation > 0.0 else "disagrees"


def _upside_down(matrix: FloatArray) -> str:
    return ": it is upside down" if matrix[2, 2] < 0.0 else ""


def _flipped(matrix: FloatArray) -> str:
    """Return what a change of axes that is no rotation of the IMU means."""
    if np.array_equal(np.abs(matrix), np.eye(3)):
        flipped = [name for name, sign in zip(AXES, np.diag(matrix), strict=True) if sign < 0.0]
        if len(flipped) == 3:
            return (
                "the IMU reports gravity and acceleration with the opposite sign: REP-145 wants "
                "specific force, +9.81 m/s² on z at rest"
            )
        verb = "has its sign" if len(flipped) == 1 else "have their signs"
        return f"the IMU's {' and '.join(flipped)} {verb} flipped (not a rotation)"
    rows = []
    for name, row in zip(("x", "y", "z"), matrix, strict=True):
        j = int(np.argmax(np.abs(row)))
        rows.append(f"{name} = {'-' if row[j] < 0.0 else ''}{AXES[j]}")
    return f"the accelerometer's axes are exchanged (not a rotation): {', '.join(rows)}"
