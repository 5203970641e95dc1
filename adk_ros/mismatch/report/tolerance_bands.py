# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Tolerance bands of cross plots, as in ISO 19364: boundaries around a simulated curve.

ISO 19364:2016 overlays measurements on a simulated curve of steering-wheel angle against lateral
acceleration. Each point of the curve has the tolerances eps_x = offset + share |x| and eps_y
in the same way, and the boundaries touch the ellipses with these half axes: at a slope K they are

    sqrt(eps_y^2 + K^2 eps_x^2)

above and below the curve. The values are those that the public implementation of S. Riedmaier
(TUMFTM/VVUQ-Framework, `calculate_iso19364_boundaries`) gives as its example; the text of the
standard, which also has limits for other quantities, was not consulted.

No standard states a tolerance for the road load in a simulation. That band follows from what this
analysis does not report: build tolerance, accelerometer offset.
"""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.inference.steady_state import Characteristic, CrossPlot
from adk_ros.mismatch.library.criteria import SENSOR_OFFSET_PRIORS, TOLERANCE_BOUND
from adk_ros.numerics.arrays import BoolArray, FloatArray

LATERAL_OFFSET, LATERAL_SHARE = 0.1, 0.06
"""m/s² and share of the lateral acceleration (see the module's reference)."""
HAND_WHEEL_OFFSET, STEERING_SHARE = np.radians(5.0), 0.03
"""rad at the steering wheel, and share of its angle (see the module's reference)."""
STEERING_RATIO = 16.0
"""
Steering-wheel over road-wheel angle, assumed: a recording has the latter. Passenger cars have 14
to 20; the band is for the eye and decides nothing.
"""


def understeer_half_width(shown: Characteristic, model: CrossPlot) -> FloatArray:
    """Return half the band (k,) of a model's understeer curve, rad at the road wheel."""
    lateral = LATERAL_OFFSET + LATERAL_SHARE * np.abs(model.x)
    size = np.interp(model.x, shown.simulation.x, shown.command_size)
    steering = HAND_WHEEL_OFFSET / STEERING_RATIO + STEERING_SHARE * size
    return np.asarray(np.hypot(steering, float(model.line[0]) * lateral))


def resistance_half_width(shown: Characteristic, model: CrossPlot) -> FloatArray:
    """
    Return half the band (k,) of a model's resistance over mass, m/s².

    The drive force over mass varies as the mass, the resistance as drag area and rolling
    resistance, each by the bound of a build tolerance; the offset of the accelerometer adds.
    """
    force = TOLERANCE_BOUND * np.interp(model.x, shown.simulation.x, shown.command_size)
    resistance = TOLERANCE_BOUND * np.abs(model.y)
    offset = SENSOR_OFFSET_PRIORS["bias_a_x"][1]
    return np.asarray(np.sqrt(force**2 + resistance**2 + offset**2))


def inside(
    measured: CrossPlot, model: CrossPlot, half_width: FloatArray, error: FloatArray
) -> BoolArray:
    """
    Return which measured points (k,) lie between the boundaries, within two standard errors.

    Beyond the range of the model's points, its ends count.
    """
    curve = np.interp(measured.x, model.x, model.y)
    width = np.interp(measured.x, model.x, half_width)
    return np.asarray(np.abs(measured.y - curve) <= width + 2.0 * error)
