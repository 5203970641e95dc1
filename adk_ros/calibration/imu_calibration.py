# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Position, mounting tilt and offsets of the IMU.

At (x, y) from odometry's reference point, in a car of yaw rate r, an accelerometer senses

    a_x = dv_x/dt - v_y r - r² x - dr/dt y + g sin(tilt) + bias
    a_y = v_x r + dv_y/dt + dr/dt x - r² y + bias

A column with the rate of v_x r + dv_y/dt takes up what is left of a delay between the streams and
the roll of the body, which would otherwise look like a position. A tilt also turns the yaw rate
into the other two axes of the gyro, which a bias or a slope of the road does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from adk_ros.calibration.criteria import MATERIAL, PERIOD_S, SIGNIFICANCE
from adk_ros.calibration.finding import Finding, judged, not_decidable
from adk_ros.calibration.grid import Signals
from adk_ros.calibration.regression import Estimate, Regression, regress
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.extrinsics import roll_pitch_yaw
from adk_ros.signals.frames import rotation

_MAX_NET_SHARE = 0.1
"""Net displacement over distance driven up to which a road counts as closed: its mean slope is
zero."""


def check_imu(s: Signals, sensors: SensorConfig, size: float = 1.0) -> Iterator[Finding]:
    """
    Yield the findings on position, tilt and offsets of the IMU.

    :param size: scale of the car's lengths (`numerics.similarity`).
    """
    if s.a is None or s.longitudinal is None or s.lateral is None:
        return
    yield _position(s, sensors, size)
    yield from _attitude(s, sensors)


def _position(s: Signals, sensors: SensorConfig, size: float) -> Finding:
    name = "imu_position"
    if s.v_y is None:
        return not_decidable(name, "odometry's v_y is not measured, whose rate looks the same")
    assert s.a is not None
    assert s.lateral is not None
    assert s.longitudinal is not None
    turning, instrument = _two_yaw_rates(s)
    sideways, forward = _design(s, turning), _design(s, instrument)
    across = regress(sideways, s.a[1] - s.lateral, s.moving, forward)
    evidence = (
        "regression of a_y - (v_x r + dv_y/dt) on dr/dt, with columns for delay, scale and offset"
    )
    if across is None:
        return not_decidable(name, f"{s.moving_s:.0f} s of driving are too few", evidence)
    x = across.estimate(0)
    along = regress(
        np.column_stack([-np.gradient(turning, PERIOD_S), np.ones_like(turning), s.longitudinal]),
        s.a[0] - s.longitudinal + turning**2 * x.value,
        s.moving,
    )
    material = MATERIAL[name].size * size
    known_x, known_y = sensors.imu_position
    left, text = known_y, "the IMU is ahead of odometry's reference point"
    if along is not None:
        y = along.estimate(0)
        if abs(y.value - known_y) >= max(material, SIGNIFICANCE * y.standard_error):
            left = y.value
            text += f" and {left:.3g} m to the left"
    proposal = [round(x.value, 3), round(left, 3)]
    return judged(
        name, x, known_x, f"{text}, in m", evidence,
        parameters={"imu_position": proposal}, scale=size,
    )  # fmt: skip


def _design(s: Signals, turning: FloatArray) -> FloatArray:
    """Return the columns (n, 5) of the lateral equation: position, delay, scale, offset, yaw."""
    assert s.v_x is not None
    assert s.v_y is not None
    assert s.longitudinal is not None
    lateral = s.v_x * turning + np.gradient(s.v_y, PERIOD_S)
    return np.column_stack(
        [
            np.gradient(turning, PERIOD_S),
            np.gradient(lateral, PERIOD_S),
            lateral,
            np.ones_like(turning),
            s.longitudinal,
        ]
    )


def _two_yaw_rates(s: Signals) -> tuple[FloatArray, FloatArray]:
    """Return a yaw rate and one of another sensor, whose noise is independent, if there is one."""
    known = [x for x in (s.gyro, s.yaw_rate, s.heading_rate) if x is not None]
    assert known
    return known[0], known[-1]


def _attitude(s: Signals, sensors: SensorConfig) -> Iterator[Finding]:
    """Yield mounting tilt and yaw, and the offsets of a_x and a_y."""
    assert s.a is not None
    assert s.lateral is not None
    assert s.longitudinal is not None
    turning, _ = _two_yaw_rates(s)
    if s.v_x is None:
        return
    ones = np.ones_like(s.v_x)
    rate = np.gradient(turning, PERIOD_S)
    columns = np.column_stack([ones, s.longitudinal, s.lateral, turning**2, rate])
    # By distance: over a closed road the mean slope along it is zero.
    weights = s.moving * np.abs(s.v_x)
    weights = weights / max(float(weights.max()), 1e-9)
    fits = [
        regress(columns, s.a[i] - expected, weights)
        for i, expected in enumerate((s.longitudinal, s.lateral))
    ]
    if fits[0] is None or fits[1] is None:
        reason = f"{s.moving_s:.0f} s of driving are too few"
        yield not_decidable("imu_attitude", reason)
        return
    offsets = [fit.estimate(0) for fit in fits if fit is not None]
    tilts = _tilts_by_gyro(s)
    for i, (axis, title) in enumerate((("a_x", "pitch"), ("a_y", "roll"))):
        # Pitch lowers a_x's axis for a positive angle (REP-103): a_x = -g sin(pitch) + ...
        sign = -1.0 if axis == "a_x" else 1.0
        for finding in _offset(s, axis, title, offsets[i], sign, tilts, sensors):
            sensors = _with_proposal(sensors, finding)
            yield finding
    yield _yaw(fits[0], sensors)


def _tilts_by_gyro(s: Signals) -> tuple[Estimate | None, Estimate | None]:
    """Return pitch and roll of the IMU from the yaw rate in its other gyro axes."""
    if s.w is None or s.gyro is None:
        return None, None
    out: list[Estimate | None] = []
    # In its axes the yaw rate of a pitched IMU is (-sin, 0, cos), of a rolled (0, sin, cos).
    for i, sign in ((0, -1.0), (1, 1.0)):
        if float(np.ptp(s.w[i])) == 0.0:
            out.append(None)
            continue
        rate = np.gradient(s.gyro, PERIOD_S)
        columns = np.column_stack([s.gyro, rate, np.ones_like(rate), s.gyro**2])
        fit = regress(columns, sign * s.w[i], s.moving)
        out.append(None if fit is None else fit.estimate(0))
    return out[0], out[1]


def _offset(
    s: Signals,
    axis: str,
    title: str,
    offset: Estimate,
    sign: float,
    tilts: tuple[Estimate | None, Estimate | None],
    sensors: SensorConfig,
) -> Iterator[Finding]:
    """Yield the offset of an axis, and the tilt where the gyro confirms it."""
    name = f"{axis}_offset"
    evidence = (
        f"mean of {axis} minus what odometry implies, by distance, at zero acceleration and "
        "yaw rate"
    )
    by_gyro = tilts[0 if axis == "a_x" else 1]
    implied = np.degrees(np.arcsin(np.clip(offset.value * sign / GRAVITY, -1.0, 1.0)))
    if by_gyro is not None and _agree(offset, by_gyro, sign):
        angles = [0.0, by_gyro.value] if axis == "a_x" else [by_gyro.value, 0.0]
        # The vector of the IMU, turned by its mounting angles, is that of the vehicle.
        total = rotation(angles[0], angles[1], 0.0) @ rotation(*sensors.imu_rotation)
        proposal = [round(x, 4) + 0.0 for x in roll_pitch_yaw(total)]
        yield judged(
            f"imu_{title}",
            by_gyro,
            0.0,
            f"the IMU is mounted with a {title} of {np.degrees(by_gyro.value):.1f}°, in rad",
            f"regression of the gyro's other axis on the yaw rate; {axis} has the offset of "
            f"{offset.value:.2f} m/s² that this tilt implies",
            kind="tilt",
            parameters={"imu_rotation": proposal},
        )
        return
    material = MATERIAL[name].size
    is_large = abs(offset.value) >= material and _errors(offset) >= SIGNIFICANCE
    is_closed, share = _closed(s)
    if is_large and axis == "a_x" and not is_closed and abs(offset.value) < 0.1 * GRAVITY:
        reason = (
            f"an offset of {offset.value:.2f} m/s² could be the mean slope: the road is not "
            f"closed (net displacement {share:.0%} of the distance)"
        )
        yield not_decidable(name, reason, evidence)
        return
    other = "the road's mean slope" if axis == "a_x" else "cross slope"
    text = (
        f"{axis} has an offset: bias, a {title} of {implied:.1f}°, or {other}; the gyro's other "
        "axes do not confirm a tilt"
        if by_gyro is not None
        else f"{axis} has an offset: bias, a {title} of {implied:.1f}°, or {other}"
    )
    bias = [offset.value, 0.0] if axis == "a_x" else [0.0, offset.value]
    yield judged(name, offset, 0.0, text, evidence, parameters={"accelerometer_bias": bias})


def _agree(offset: Estimate, by_gyro: Estimate, sign: float) -> bool:
    """Whether an offset and a tilt by the gyro are both material and the same angle."""
    size = MATERIAL["tilt"].size
    if abs(by_gyro.value) < size or _errors(by_gyro) < SIGNIFICANCE:
        return False
    implied = float(np.arcsin(np.clip(offset.value * sign / GRAVITY, -1.0, 1.0)))
    scatter = np.hypot(offset.standard_error / GRAVITY, by_gyro.standard_error)
    return bool(abs(implied - by_gyro.value) < max(size, SIGNIFICANCE * scatter))


def _with_proposal(sensors: SensorConfig, finding: Finding) -> SensorConfig:
    """Return the configuration with the rotation that a finding proposes, for the next one."""
    proposal = finding.parameters.get("imu_rotation")
    return sensors if proposal is None else replace(sensors, imu_rotation=tuple(proposal))


def _yaw(fit: Regression, sensors: SensorConfig) -> Finding:
    """Return the yaw of the mounting: the share of the lateral acceleration in a_x."""
    evidence = "regression of a_x - (dv_x/dt - v_y r) on v_x r + dv_y/dt"
    yaw = fit.estimate(2)
    total = rotation(0.0, 0.0, yaw.value) @ rotation(*sensors.imu_rotation)
    proposal = [round(x, 4) + 0.0 for x in roll_pitch_yaw(total)]
    text = "the IMU is turned about the vertical axis (share of the lateral acceleration in a_x)"
    return judged("imu_yaw", yaw, 0.0, text, evidence, parameters={"imu_rotation": proposal})


def _closed(s: Signals) -> tuple[bool, float]:
    """Return whether the car came back to where it started, and net displacement by distance."""
    if s.x is None or s.y is None or s.v_x is None:
        return False, 1.0
    distance = float(np.abs(s.v_x).sum()) * PERIOD_S
    net = float(np.hypot(s.x[-1] - s.x[0], s.y[-1] - s.y[0]))
    share = net / max(distance, 1e-9)
    return share < _MAX_NET_SHARE, share


def _errors(estimate: Estimate) -> float:
    return abs(estimate.value) / max(estimate.standard_error, 1e-12)
