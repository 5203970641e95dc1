# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Linear response of the residuals to an additional acceleration or angle, for screening features.

Runs of the surrogate with random additional accelerations and angles, compared with one without,
give a linear lateral model whose coefficients depend on speed as those of a bicycle model do. The
column of a feature then costs a recursion over the recording instead of a run of the equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.surrogate.feature_terms import STEERING
from adk_ros.mismatch.surrogate.residuals import MAX_RESIDUAL, OBSERVER_GAINS, STEP_S
from adk_ros.mismatch.surrogate.state_index import (
    A_Y,
    IMU_A_X,
    IMU_A_Y,
    IMU_YAW_RATE,
    ODOMETRY_V_X,
    ODOMETRY_V_Y,
    ODOMETRY_YAW_RATE,
    V_Y,
    YAW_RATE,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.filters import causal_filter, low_pass
from adk_ros.numerics.numba_cache import strict_kernel

_PROBE_SIZE = (0.2, 0.1)
"""Additional lateral and yaw acceleration of the probe, m/s² and rad/s²: tyres stay linear."""
_PROBE_ANGLE = 0.004
"""Additional road-wheel angle of the second probe, rad: about the same lateral acceleration."""
_PROBE_HOLD_STEPS = 40
"""Steps for which the probe's sign is held: 0.4 s, near the car's yaw mode."""
_MIN_SPEED = 3.0
"""m/s, of a full-size car; slower, the coefficients are those of this speed."""
_INPUTS = ("v_y", "yaw_rate", STEERING)
_STATES = 5
"""Terms of the response before those of the inputs."""
_LATERAL_CHANNELS = (IMU_A_Y, IMU_YAW_RATE, ODOMETRY_V_Y, ODOMETRY_YAW_RATE)


@dataclass(frozen=True)
class LinearResponse:
    """
    Response of the whitened residuals to a feature added to one equation.

    `coefficients` (3, 8): of dv_y/dt, dr/dt and a_y on v_y/v_x, r/v_x, v_y, r, r v_x, and the
    added lateral and yaw acceleration and road-wheel angle.
    """

    linearised: LinearisedProblem
    speed: FloatArray
    coefficients: FloatArray

    @classmethod
    def of(cls, linearised: LinearisedProblem) -> LinearResponse:
        """Identify the response at the hypothesis of a linearised problem."""
        likelihood, h = linearised.likelihood, linearised.hypothesis
        problem = likelihood.problem
        p, terms = likelihood.simulation_inputs(h.nuisances, h.effects)
        speed = np.maximum(
            np.abs(problem.smoothed_odometry[:, 0]), problem.log.similar(_MIN_SPEED)
        )
        probe = np.zeros((problem.steps, 4))
        steered = np.zeros_like(probe)
        signs = np.random.default_rng(0).integers(
            0, 2, (problem.steps // _PROBE_HOLD_STEPS + 1, 2)
        )
        held = np.repeat(2.0 * signs - 1.0, _PROBE_HOLD_STEPS, axis=0)[: problem.steps]
        probe[:, 1:3] = held * _PROBE_SIZE
        steered[:, 3] = held[:, 0] * _PROBE_ANGLE
        without = problem.run(p, terms)
        rows, targets = _regression(problem.run(p, terms, extra=probe) - without, speed)
        rows = np.hstack([rows, probe[:-1, 1:3]])
        solved, *_ = np.linalg.lstsq(rows, targets, rcond=None)
        # A steering angle acts with the same motion, so that only its own coefficients are left.
        rows, targets = _regression(problem.run(p, terms, extra=steered) - without, speed)
        angle = steered[:-1, 3]
        by_angle = angle @ (targets - rows @ solved[:_STATES]) / (angle @ angle)
        return cls(linearised, speed, np.ascontiguousarray(np.vstack([solved, by_angle]).T))

    def column(self, equation: str, feature: FloatArray) -> FloatArray:
        """Return the change (m,) of the projected residuals by a feature (n,) in an equation."""
        likelihood = self.linearised.likelihood
        problem = likelihood.problem
        out = np.zeros(self.linearised.e.shape[0])
        if equation == "v_x":
            gain = float(OBSERVER_GAINS[0])
            change = {
                IMU_A_X: feature,
                ODOMETRY_V_X: low_pass(feature, STEP_S, 1.0 / gain) / gain,
            }
        else:
            response = propagate(
                feature, self.speed, self.coefficients, STEP_S, _INPUTS.index(equation)
            )
            if problem.log.length_scale < 1.0 and not np.abs(response).max() < MAX_RESIDUAL:
                # The recursion may diverge for a scale model, whose dynamics are fast for its
                # step: such a feature is not screened.
                return out
            change = dict(zip(_LATERAL_CHANNELS, response[[2, 1, 0, 1]], strict=True))
        for channel, values in change.items():
            # As `Likelihood.whiten`, for the channels that the equation changes.
            weights = likelihood.weights[channel]
            whitened = causal_filter(problem.binned(values) * weights, likelihood.filters[channel])
            begin = channel * problem.bins
            out[begin : begin + problem.bins] = -whitened * (weights != 0.0)
        return np.asarray(self.linearised.project_out(out * self.linearised.root))

    def gain(self, columns: FloatArray) -> tuple[FloatArray, float]:
        """Return the sizes (k,) of projected columns (m, k), and the gain in loss."""
        normal = columns.T @ columns
        right = -(columns.T @ self.linearised.projected)
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
        inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-8, hermitian=True)
        size = inverse @ (right / scale) / scale
        return np.asarray(size), float(right @ size)


def _regression(change: FloatArray, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the states of the response (n - 1, 5), and what depends on them (n - 1, 3)."""
    v_y, rate = change[V_Y], change[YAW_RATE]
    rows = np.column_stack([v_y / speed, rate / speed, v_y, rate, rate * speed])
    targets = [np.diff(v_y) / STEP_S, np.diff(rate) / STEP_S, change[A_Y][:-1]]
    return rows[:-1], np.column_stack(targets)


@strict_kernel
def propagate(
    feature: FloatArray, speed: FloatArray, coefficients: FloatArray, step: float, at: int
) -> FloatArray:
    """Return v_y, yaw rate and lateral acceleration (3, n) for a feature as input `at`."""
    n = feature.shape[0]
    out = np.empty((3, n))
    v_y, rate = 0.0, 0.0
    row = np.zeros(_STATES + 3)
    for k in range(n):
        v = speed[k]
        row[0], row[1], row[2], row[3], row[4] = v_y / v, rate / v, v_y, rate, rate * v
        row[_STATES + at] = feature[k]
        derivative_v, derivative_r, acceleration = 0.0, 0.0, 0.0
        for j in range(row.shape[0]):
            derivative_v += coefficients[0, j] * row[j]
            derivative_r += coefficients[1, j] * row[j]
            acceleration += coefficients[2, j] * row[j]
        v_y += step * derivative_v
        rate += step * derivative_r
        out[0, k], out[1, k], out[2, k] = v_y, rate, acceleration
    return out
