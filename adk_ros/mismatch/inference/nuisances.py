# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Nuisance parameters: their order, priors and bounds, and what they do to the surrogate.

They describe differences that are no mismatch: build tolerances of a dozen vehicle parameters,
sensor offsets, and the directions that the simulation determines poorly, in this order. Each has a
Gaussian prior and a hard bound; without the bound they absorb effects.
"""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.library.criteria import (
    SENSOR_OFFSET_PRIORS,
    TOLERANCE_BOUND,
    TOLERANCE_SIGMA,
    WEAK_DIRECTION_BOUND,
)
from adk_ros.mismatch.library.surrogate_parameters import HIGH, INDEX, LOW
from adk_ros.numerics.arrays import FloatArray

TOLERANCE_PARAMETERS = (
    "mass",
    "yaw_inertia",
    "cg_to_front_axle",
    "cg_to_rear_axle",
    "cg_height",
    "stiffness_f",
    "stiffness_r",
    "grip_f",
    "grip_r",
    "wheel_radius",
    "drag_area",
    "rolling",
)
"""Vehicle parameters with a build tolerance."""
_TOLERANCE_STEP = 0.002
_SENSOR_OFFSET_STEPS = {"bias_a_x": 0.005, "bias_a_y": 0.005, "bias_gyro": 2e-4}
_WEAK_DIRECTION_STEP = 0.2

_TOLERANCE_INDEX = np.array([INDEX[name] for name in TOLERANCE_PARAMETERS])
_OFFSET_INDEX = np.array([INDEX[name] for name in SENSOR_OFFSET_PRIORS])
_OFFSET_PRIORS = np.array(list(SENSOR_OFFSET_PRIORS.values()))
_OFFSET_STEPS = np.array([_SENSOR_OFFSET_STEPS[name] for name in SENSOR_OFFSET_PRIORS])
N_FIXED_NUISANCES = len(TOLERANCE_PARAMETERS) + len(SENSOR_OFFSET_PRIORS)
"""Tolerances and sensor offsets; the weakly identified directions follow them."""


def along_weak_directions(nuisances: FloatArray, weak: int) -> FloatArray:
    """Return the nuisance parameters (weak,) of the weakly determined directions."""
    return nuisances[N_FIXED_NUISANCES : N_FIXED_NUISANCES + weak]


def with_nuisances(
    parameters: FloatArray, weak_directions: FloatArray, nuisances: FloatArray
) -> FloatArray:
    """
    Return the surrogate's parameters (SIZE,) with nuisance parameters applied.

    Tolerances are relative, sensor offsets absolute, weak directions (k, SIZE) in standard
    deviations.
    """
    k = len(TOLERANCE_PARAMETERS)
    along = along_weak_directions(nuisances, weak_directions.shape[0])
    p = np.clip(parameters + along @ weak_directions, LOW, HIGH)
    p[_TOLERANCE_INDEX] *= 1.0 + nuisances[:k]
    p[_OFFSET_INDEX] += nuisances[k:N_FIXED_NUISANCES]
    return np.asarray(p)


def steps(weak: int) -> FloatArray:
    """Return the difference steps of the nuisance parameters, `weak` directions among them."""
    tolerances = np.full(len(TOLERANCE_PARAMETERS), _TOLERANCE_STEP)
    return np.concatenate([tolerances, _OFFSET_STEPS, np.full(weak, _WEAK_DIRECTION_STEP)])


def bounds(weak: int) -> FloatArray:
    """Return the symmetric bounds of the nuisance parameters, `weak` directions among them."""
    tolerances = np.full(len(TOLERANCE_PARAMETERS), TOLERANCE_BOUND)
    return np.concatenate([tolerances, _OFFSET_PRIORS[:, 1], np.full(weak, WEAK_DIRECTION_BOUND)])


def deviations(weak: int) -> FloatArray:
    """Return the prior standard deviations, of `weak` directions among them."""
    tolerances = np.full(len(TOLERANCE_PARAMETERS), TOLERANCE_SIGMA)
    return np.concatenate([tolerances, _OFFSET_PRIORS[:, 0], np.ones(weak)])
