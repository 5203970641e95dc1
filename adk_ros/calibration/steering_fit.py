# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Regressions of the steering angle on the motion, with a delay.

Single-track model (ISO 4138, 2021; ISO 7401, 2011), of any car with a yaw rate:

    v_x delta(t - delay) = c (L r + K v_x² r) + c T v_x dr/dt + o v_x

with the wheelbase L, the understeer gradient K and a lag T of the yaw response; c is the steer
joint's angle over the road-wheel angle, o the offset. Front axle, where v_y is measured:

    v_x delta(t - delay) = c (v_y + l_f r) + C v_x a_y + D v_x dr/dt + o v_x

The slip angle of the front axle is in phase with its side force, so nothing but the steering
itself and the relaxation of the tyres delays it: it gives the delay. Its c is biased by a few per
cent, since a tyre's stiffness follows the wheel load, and only confirms the other one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.calibration.criteria import MAX_LAG_S, MAX_LATERAL, MIN_CORRELATION, PERIOD_S
from adk_ros.calibration.grid import Signals, by_speed, shifted, smooth
from adk_ros.calibration.regression import Estimate, Regression, regress
from adk_ros.calibration.signs_and_units import gain
from adk_ros.numerics.arrays import FloatArray

_ITERATIONS, _LARGEST_STEP_S, _TOLERANCE_S = 15, 0.1, 1e-3


@dataclass(frozen=True)
class SteeringFit:
    """Coefficients of one of the models in its order, the delay (s) apart."""

    regression: Regression
    delay: Estimate


def linear_range(s: Signals, is_by_speed: bool = True) -> FloatArray:
    """
    Return weights (n,) of driving ahead in the linear range of the tyres.

    :param is_by_speed: in proportion to v_x², else equal.
    """
    assert s.v_x is not None
    assert s.turning is not None
    weights = by_speed(s) if is_by_speed else s.moving
    return np.asarray(weights * (np.abs(s.v_x * s.turning) < MAX_LATERAL) * (s.v_x > 0.0))


def single_track(s: Signals, turning: FloatArray) -> FloatArray:
    """Return the columns (n, 4) of the single-track model from a yaw rate: L, K, o, T."""
    assert s.v_x is not None
    return np.column_stack(
        [turning, s.v_x**2 * turning, s.v_x, s.v_x * np.gradient(turning, PERIOD_S)]
    )


def front_axle(s: Signals, turning: FloatArray, ahead: float) -> FloatArray:
    """Return the columns (n, 4) of the front axle, `ahead` m before v_y's point: 1, C, o, D."""
    assert s.v_x is not None
    assert s.v_y is not None
    lateral = s.v_x * turning + np.gradient(s.v_y, PERIOD_S)
    rate = np.gradient(turning, PERIOD_S)
    return np.column_stack([s.v_y + ahead * turning, s.v_x * lateral, s.v_x, s.v_x * rate])


def sideways_is_measured(s: Signals) -> bool:
    """Whether v_y varies and does not contradict the lateral velocity of the pose."""
    if s.v_y is None:
        return False
    if s.leftward is None:
        return True
    g = gain(s.v_y, s.leftward, s.moving)
    return g is not None and g.correlation >= MIN_CORRELATION


def fit_single_track(
    s: Signals, delay_s: float | None = None, is_by_speed: bool = True
) -> SteeringFit | None:
    """Return the single-track model with its delay, or at a given one; None if undecided."""
    if s.steering is None or s.v_x is None or s.turning is None:
        return None
    columns, instruments = (single_track(s, turning) for turning in _yaw_rates(s))
    if delay_s is None:
        return _fit(s, columns, instruments)
    target = s.v_x * smooth(shifted(s.steering, delay_s))
    fit = regress(columns, target, linear_range(s, is_by_speed), instruments)
    delay = Estimate(delay_s, 0.0, delay_s, delay_s, 0.0)
    return None if fit is None else SteeringFit(fit, delay)


def fit_front_axle(s: Signals, ahead: float) -> SteeringFit | None:
    """Return the model of the front axle, `ahead` m before the point of v_y; None if undecided."""
    if s.steering is None or s.v_x is None or s.turning is None or s.v_y is None:
        return None
    columns, instruments = (front_axle(s, turning, ahead) for turning in _yaw_rates(s))
    return _fit(s, columns, instruments)


def _yaw_rates(s: Signals) -> tuple[FloatArray, FloatArray]:
    """Return a yaw rate, and one of another sensor as its instrument."""
    assert s.turning is not None
    others = [x for x in (s.gyro, s.yaw_rate) if x is not None and x is not s.turning]
    return s.turning, others[0] if others else s.turning


def _fit(s: Signals, columns: FloatArray, instruments: FloatArray) -> SteeringFit | None:
    """Return the fit with the delay found by Gauss-Newton steps; None if it does not converge."""
    assert s.steering is not None
    assert s.v_x is not None
    weights = linear_range(s)
    delay = 0.0
    for _ in range(_ITERATIONS):
        target = s.v_x * smooth(shifted(s.steering, delay))
        # A signal that is delayed a little more changes by its derivative.
        slope = np.gradient(target, PERIOD_S)
        fit = regress(
            np.column_stack([columns, slope]),
            target,
            weights,
            np.column_stack([instruments, slope]),
        )
        if fit is None:
            return None
        step = float(fit.values[-1])
        if abs(step) < _TOLERANCE_S:
            return SteeringFit(fit, fit.estimate(fit.values.size - 1).shifted(delay))
        delay += float(np.clip(step, -_LARGEST_STEP_S, _LARGEST_STEP_S))
        if abs(delay) > MAX_LAG_S:
            return None
    return None
