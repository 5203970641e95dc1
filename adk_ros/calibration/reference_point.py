# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the point of odometry's twist lies along the car, and whether its axes are those of the car.

The lateral velocity at l ahead of the rear axle is v_y = l r - C v_x a_y, with the cornering
compliance C of the rear axle and a_y = v_x r: at low lateral acceleration the rear axle follows
its heading (M. Abe, Vehicle Handling Dynamics, 2015, section 3.3). In axes that are turned to the
left by e it is lower by e v_x.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from adk_ros.calibration.criteria import MAX_LATERAL, MIN_CORRELATION, PERIOD_S
from adk_ros.calibration.finding import Finding, Verdict, judged, not_decidable
from adk_ros.calibration.grid import Signals
from adk_ros.calibration.regression import Estimate, Regression, regress
from adk_ros.calibration.steering_fit import sideways_is_measured
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.similarity import length_scale
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions
from adk_ros.signals.decode import SensorConfig

_EVIDENCE = "regression of odometry's v_y on r, v_x² r, v_x, v_x dr/dt below 4 m/s²"
_POINT, _AXES = "reference_point", "odometry_rotation"


def check_reference_point(
    s: Signals, sensors: SensorConfig, vehicle: Dimensions | None
) -> Iterator[Finding]:
    """Yield the distance of odometry's twist from the rear axle, and the angle of its axes."""
    if s.v_x is None or s.turning is None:
        return
    if s.v_y is None:
        yield not_decidable(_POINT, "odometry's v_y is not measured")
        return
    weights = s.moving * (np.abs(s.v_x * s.turning) < MAX_LATERAL) * (s.v_x > 0.0)
    rate = np.gradient(s.turning, PERIOD_S)

    def columns(turning: FloatArray) -> FloatArray:
        assert s.v_x is not None
        return np.column_stack([turning, s.v_x**2 * turning, s.v_x, s.v_x * rate])

    other = s.gyro if s.gyro is not None else s.yaw_rate
    instruments = None if other is None else columns(other)
    driven = columns(s.turning)
    fit = regress(driven, s.v_y, weights, instruments)
    if fit is None:
        reason = "there is too little driving in the linear range"
        yield not_decidable(_POINT, reason, _EVIDENCE)
        return
    explained = _explained(driven, s.v_y, weights, fit.values)
    if explained < MIN_CORRELATION**2:
        reason = f"yaw rate and speed explain only {explained:.0%} of the variance of v_y"
        yield not_decidable(_POINT, reason, _EVIDENCE)
        return
    if not sideways_is_measured(s) and not _heading_is_the_course(s, fit, driven, weights):
        reason = "v_y and the lateral velocity of the pose contradict each other"
        yield not_decidable(_POINT, reason, _EVIDENCE)
        return
    yield _point(fit.estimate(0), sensors, vehicle)
    yield _axes(fit)


def _point(length: Estimate, sensors: SensorConfig, vehicle: Dimensions | None) -> Finding:
    """Return the verdict on the distance from the rear axle."""
    if vehicle is None:
        return Finding(
            _POINT,
            Verdict.NOT_DECIDABLE,
            "not decidable, because the vehicle is unknown: give --vehicle; the twist is that of "
            f"a point {length.value:.2f} m ahead of the rear axle ({length.low:.2f} to "
            f"{length.high:.2f})",
            length.value,
            length.low,
            length.high,
            "m",
            evidence=_EVIDENCE,
            seconds=length.seconds,
        )
    # The configured reference point is where the centre of gravity lies from the twist's point.
    nominal = vehicle.cg_to_rear_axle - sensors.reference_point[0]
    ahead = round(vehicle.cg_to_rear_axle - length.value, 3)
    return judged(
        _POINT,
        length,
        nominal,
        "odometry's twist is that of a point ahead of the rear axle by, in m",
        _EVIDENCE,
        parameters={_POINT: [ahead, sensors.reference_point[1]]},
        scale=length_scale(vehicle.cg_to_front_axle + vehicle.cg_to_rear_axle),
    )


def _axes(fit: Regression) -> Finding:
    """Return the verdict on the angle of the axes of odometry's twist."""
    turned = Estimate.of(-float(fit.values[2]), -fit.resampled[:, 2], fit.seconds)
    return judged(
        _AXES,
        turned,
        0.0,
        "v_y differs from zero in straight driving as if the axes of odometry's twist were turned "
        "to the left by",
        _EVIDENCE,
        parameters={_AXES: turned.value},
    )


def _heading_is_the_course(
    s: Signals, of_twist: Regression, columns: FloatArray, weights: FloatArray
) -> bool:
    """
    Whether the pose's lateral velocity is none of a car, while `of_twist`, the fit of v_y, is.

    A heading that is computed from the course leaves no lateral velocity, but filters and noise.
    That of a car follows from the yaw rate, with a compliance C of the rear axle that is positive.
    """
    if s.leftward is None or of_twist.values[1] >= 0.0:
        return False
    of_pose = regress(columns, s.leftward, weights)
    if of_pose is None:
        return False
    return _explained(columns, s.leftward, weights, of_pose.values) < MIN_CORRELATION**2


def _explained(
    columns: FloatArray, target: FloatArray, weights: FloatArray, values: FloatArray
) -> float:
    """Return the share of the weighted variance of a target that a regression explains."""
    residual = target - columns @ values
    mean = float(weights @ target) / max(float(weights.sum()), 1e-9)
    power = float(weights @ (target - mean) ** 2)
    return 1.0 - float(weights @ residual**2) / max(power, 1e-12)
