# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The single-track model in the lifting, for states outside the range of the training data.

Per unit of mass, with the drive k T, the slip angles a and the axle loads N,

    dv_x/dt = a_x - F_f sin(delta) + r v_y,    a_x = k T - c_0 v_x / v - c_2 v_x |v_x|
    dv_y/dt = F_f cos(delta) + F_r - r v_x
    dr/dt   = j (l_f F_f cos(delta) - l_r F_r)
    a_f = (v_x delta - v_y - l_f r) / v,  a_r = (l_r r - v_y) / v,   v = max(|v_x|, v_0)
    F = mu N sqrt(max(1 - (k T / mu g)^2, 1/4)) tanh(B a / mu),  N_f = g l_r / L - h a_x,
    N_r = g l_f / L + h a_x

(Rajamani, Vehicle Dynamics and Control, 2012, sections 2.3 and 13; a tanh saturates as the Magic
Formula with shape factor 1; loads are at least 0). T and delta are the commands after first-order
lags, means over the tick. A tick is one step of the midpoint rule. At v_0 the faster of sway and
yaw decays at a rate of one per tick, half the limit of stability; below it the rate stays the
same. Parameters are identified from the training data (`adk_ros.train.single_track_fit`).

Learned features are only valid within the range of the training data. Their weight

    w = 1 / (1 + sum of e^2)^2

falls with the distances e by which speed, torque, steering, slip angles and lateral acceleration
lie outside the training data, in units of `RANGE_SOFTNESS` widths of their range. This range is
narrower than `TrainingRange`, which the diagnostics report: it is of slip angles, too, and without
a margin.

Kernels with arguments of type `Any` compute in the precision of their arguments: float32 in the
encoder, float64 for derivatives and for the identification. Constants are float32 numbers in both.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adk_ros.model.lifting.rational_tanh import rational_tanh
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.numba_cache import inlined_kernel, ordered_kernel
from adk_ros.signals.score import TICK_S

RANGE_SOFTNESS = 0.1
"""Distance, in widths of the range, at which learned features have a weight of 1/4; by choice."""
SINGLE_TRACK_FEATURES = 6
"""Increments of the state, lateral forces of the axles, and the drive."""
RANGE_QUANTITIES = 6
"""Speed, torque, steering, slip angles of front and rear axle, lateral acceleration."""
LIMITS_SIZE = 3 * RANGE_QUANTITIES
"""Values of `limits`: lower ends, upper ends, and 1 / softness of the ranges."""
FORCE_SCALE = 0.25
"""Factor on the forces, m/s², that makes them about as large as the other features."""
MIN_GRIP = 0.25
"""Square of the share of the lateral grip that a drive leaves at least; by choice."""


class SingleTrackParameters(NamedTuple):
    """
    Parameters per unit of mass, SI: the first part of the vector `car` of an encoder.

    `front`, `rear`: distances of the axles from the centre of gravity; `front_stiffness`,
    `rear_stiffness`: B, cornering stiffness by load; `front_friction`, `rear_friction`: mu;
    `yaw`: j, mass by yaw inertia; `drive`: k; `rolling`: c_0; `drag`: c_2; `transfer`: h, height
    of the centre of gravity by wheelbase; `slowest`: v_0.
    """

    front: float
    rear: float
    front_stiffness: float
    rear_stiffness: float
    front_friction: float
    rear_friction: float
    yaw: float
    drive: float
    rolling: float
    drag: float
    transfer: float
    slowest: float


GAIN = len(SingleTrackParameters._fields)
MEAN, SCALE, COMMAND, BLEND = GAIN + 3, GAIN + 6, GAIN + 9, GAIN + 11
CAR_SIZE = BLEND + 1
"""
Values of `car`: parameters, scaled increments by SI ones (3,), mean (3,) and scale (3,) of the
state, mean (2,) of the command, from `GAIN`, `MEAN`, `SCALE` and `COMMAND` on; at `BLEND` b of the
increments' weight 1 - b w: 1 if quadratic features predict them within the range, 0 if not.
"""
_single = np.float32
_ZERO, _ONE, _HALF, _SIXTH = (_single(v) for v in (0.0, 1.0, 0.5, 1.0 / 6.0))
_24TH, _120TH = _single(1.0 / 24.0), _single(1.0 / 120.0)
_GRAVITY, _MIN_GRIP, _FORCE_SCALE = (_single(v) for v in (GRAVITY, MIN_GRIP, FORCE_SCALE))
_TICK, _HALF_TICK = _single(TICK_S), _single(0.5 * TICK_S)
_DIFFERENCE = 1e-5
"""Step of central differences, about the cube root of the precision of float64."""


@inlined_kernel
def slip_angles(v_x: Any, v_y: Any, rate: Any, delta: Any, car: Any) -> Any:
    """Return the slip angles of front and rear axle, and v, m/s."""
    speed = max(abs(v_x), car[11])
    return (v_x * delta - v_y - car[0] * rate) / speed, (car[1] * rate - v_y) / speed, speed


@inlined_kernel
def single_track_slope(v_x: Any, v_y: Any, rate: Any, torque: Any, delta: Any, car: Any) -> Any:
    """Return the derivatives of the state, forces of front and rear axle, and the drive, SI."""
    front, rear, speed = slip_angles(v_x, v_y, rate, delta, car)
    drive = car[7] * torque
    a_x = drive - car[8] * v_x / speed - car[9] * v_x * abs(v_x)
    length = car[0] + car[1]
    of_front, of_rear = drive / (car[4] * _GRAVITY), drive / (car[5] * _GRAVITY)
    grip_front = np.sqrt(max(_ONE - of_front * of_front, _MIN_GRIP))
    grip_rear = np.sqrt(max(_ONE - of_rear * of_rear, _MIN_GRIP))
    load_front = max(_GRAVITY * car[1] / length - car[10] * a_x, _ZERO)
    load_rear = max(_GRAVITY * car[0] / length + car[10] * a_x, _ZERO)
    f_front = car[4] * load_front * grip_front * rational_tanh(car[2] / car[4] * front)
    f_rear = car[5] * load_rear * grip_rear * rational_tanh(car[3] / car[5] * rear)
    s = delta * delta
    cos = _ONE - s * (_HALF - s * _24TH)
    sin = delta * (_ONE - s * (_SIXTH - s * _120TH))
    across = f_front * cos
    return (
        a_x - f_front * sin + rate * v_y,
        across + f_rear - rate * v_x,
        car[6] * (car[0] * across - car[1] * f_rear),
        f_front,
        f_rear,
        drive,
    )


@inlined_kernel
def single_track_change(v_x: Any, v_y: Any, rate: Any, torque: Any, delta: Any, car: Any) -> Any:
    """Return the change of the state over a tick, SI, and the forces at its start."""
    half = _HALF_TICK
    s = single_track_slope(v_x, v_y, rate, torque, delta, car)
    m = single_track_slope(
        v_x + half * s[0], v_y + half * s[1], rate + half * s[2], torque, delta, car
    )
    return _TICK * m[0], _TICK * m[1], _TICK * m[2], s[3], s[4], s[5]


@inlined_kernel
def excess(value: Any, limits: Any, k: Any) -> Any:
    """Return the squared distance of a value from range k of `limits` (18,)."""
    n = RANGE_QUANTITIES
    e = max(limits[k] - value, value - limits[n + k], _ZERO) * limits[2 * n + k]
    return e * e


@inlined_kernel
def trained_share(
    v_x: Any, v_y: Any, rate: Any, torque: Any, delta: Any, car: Any, limits: Any
) -> Any:
    """Return the weight w of learned features; `limits` (18,), see `LIMITS_SIZE`."""
    front, rear, _ = slip_angles(v_x, v_y, rate, delta, car)
    total = (
        excess(v_x, limits, 0)
        + excess(torque, limits, 1)
        + excess(delta, limits, 2)
        + excess(front, limits, 3)
        + excess(rear, limits, 4)
        + excess(v_x * rate, limits, 5)
    )
    return _ONE / ((_ONE + total) * (_ONE + total))


@inlined_kernel
def single_track_features(
    v_x: Any, v_y: Any, rate: Any, torque: Any, delta: Any, car: Any, limits: Any
) -> Any:
    """Return the six features and w, of a scaled state and a command, SI, less its mean."""
    v_x = car[SCALE] * v_x + car[MEAN]
    v_y = car[SCALE + 1] * v_y + car[MEAN + 1]
    rate = car[SCALE + 2] * rate + car[MEAN + 2]
    torque = torque + car[COMMAND]
    delta = delta + car[COMMAND + 1]
    c = single_track_change(v_x, v_y, rate, torque, delta, car)
    weight = trained_share(v_x, v_y, rate, torque, delta, car, limits)
    share = _ONE - car[BLEND] * weight
    return (
        share * c[0] * car[GAIN], share * c[1] * car[GAIN + 1], share * c[2] * car[GAIN + 2],
        _FORCE_SCALE * c[3], _FORCE_SCALE * c[4], _FORCE_SCALE * c[5], weight,
    )  # fmt: skip


@ordered_kernel
def single_track_derivative(
    point: FloatArray, car: FloatArray, limits: FloatArray, values: FloatArray, slopes: FloatArray
) -> None:
    """
    Write `single_track_features` (7,) at `point` (5,), and their derivatives (7, 5).

    By central differences in float64, also where a limit acts. `point` is a scaled state, and a
    filtered command, SI, less its mean. `limits` (18,).
    """
    f = single_track_features(point[0], point[1], point[2], point[3], point[4], car, limits)
    for k in range(7):
        values[k] = f[k]
    for j in range(5):
        kept = point[j]
        # Commands are in units of the softness of their range.
        unit = 1.0 if j < 3 else min(1.0, 1.0 / limits[2 * RANGE_QUANTITIES + j - 2])
        step = _DIFFERENCE * max(unit, abs(kept))
        point[j] = kept + step
        f = single_track_features(point[0], point[1], point[2], point[3], point[4], car, limits)
        point[j] = kept - step
        g = single_track_features(point[0], point[1], point[2], point[3], point[4], car, limits)
        point[j] = kept
        for k in range(7):
            slopes[k, j] = (f[k] - g[k]) / (2.0 * step)


@ordered_kernel
def single_track_batch(
    points: FloatArray, car: FloatArray, limits: FloatArray, slopes: FloatArray
) -> FloatArray:
    """
    Return the features (b, 7) at `points` (b, 5); write their derivatives (b, 7, 5).

    `limits` (3, 6).
    """
    values, flat = np.empty((len(points), 7)), limits.reshape(-1)
    for i in range(len(points)):
        single_track_derivative(points[i], car, flat, values[i], slopes[i])
    return values
