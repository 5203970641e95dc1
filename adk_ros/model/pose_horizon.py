# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A horizon of velocities integrated to poses in a fixed frame, with their covariance.

With v = (v_x, v_y, r) at the steps and the heading psi, by the trapezoidal rule over a step dt:

    psi' = r,    (x, y)' = R(psi) (v_x, v_y)

The errors of a horizon's velocities last: one too fast stays too fast. They are taken as fully
correlated along the horizon, e_h = L_h w with L_h L_h^T = C_h and the same w at all steps, which
adds up the largest pose errors that the covariances C_h allow, and keeps them linear in w.
"""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS

_TICK_S = TICK_NS * 1e-9
_MIN_VARIANCE = 1e-30
"""SI units squared; only a guard against a division by zero."""
_REGULARIZATION = 1e-9
"""Added to the scaled variances: far above the rounding of a singular matrix."""


def moved_pose(pose: FloatArray, velocity: FloatArray, duration_s: float) -> FloatArray:
    """Return a pose (x, y, heading), m and rad, after a time at a velocity (3,) in its axes."""
    v_x, v_y, rate = velocity
    middle = pose[2] + 0.5 * rate * duration_s
    cos, sin = np.cos(middle), np.sin(middle)
    change = np.array([v_x * cos - v_y * sin, v_x * sin + v_y * cos, rate])
    return np.asarray(pose + duration_s * change)


class CarriedPose:
    """
    The pose of a vehicle at samples after its latest measured pose.

    From sample to sample it is moved by the mean of the two velocities, so that a vehicle that
    brakes while odometry is missing does not move at the speed of the end all the time.
    """

    def __init__(self) -> None:
        self._measured_ns: int | None = None
        self._stamp_ns = 0
        self._pose = self._velocity = np.zeros(3)

    def at(
        self, stamp_ns: int, velocity: FloatArray, measured_ns: int, measured: FloatArray
    ) -> FloatArray:
        """
        Return the pose (3,) at a sample where the vehicle has a `velocity` (3,) in its axes, SI.

        :param measured: the latest measured pose (3,), of `measured_ns`, before or after.
        """
        # A sample before the measurement has been moved back, at a velocity of before as well.
        continues = measured_ns == self._measured_ns and measured_ns <= self._stamp_ns < stamp_ns
        if continues:
            mean, after_ns = 0.5 * (self._velocity + velocity), stamp_ns - self._stamp_ns
            pose = moved_pose(self._pose, mean, after_ns * 1e-9)
        else:
            pose = moved_pose(measured, velocity, (stamp_ns - measured_ns) * 1e-9)
        self._measured_ns, self._stamp_ns = measured_ns, stamp_ns
        self._pose, self._velocity = pose, np.array(velocity)
        return pose


def pose_horizon(pose: FloatArray, present: FloatArray, horizon: FloatArray) -> FloatArray:
    """
    Return the poses (h, 3), x and y in m and heading in rad, at the steps of a horizon.

    `pose` (3,) and the velocities `present` (3,) are of the sample that `horizon` (h, 3) starts
    from, SI; all velocities are those of the point whose pose it is.
    """
    mean = 0.5 * (np.vstack([present[None], horizon[:-1]]) + horizon)
    heading = pose[2] + _TICK_S * np.cumsum(mean[:, 2])
    middle = heading - 0.5 * _TICK_S * mean[:, 2]
    cos, sin = np.cos(middle), np.sin(middle)
    x = pose[0] + _TICK_S * np.cumsum(mean[:, 0] * cos - mean[:, 1] * sin)
    y = pose[1] + _TICK_S * np.cumsum(mean[:, 0] * sin + mean[:, 1] * cos)
    return np.column_stack([x, y, heading])


def _root(covariance: FloatArray) -> FloatArray:
    """
    Return lower triangular L (h, 3, 3) with L L^T = `covariance` to `_REGULARIZATION`.

    A channel without error, or errors that depend on each other exactly, leave it singular.
    """
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    scale = np.sqrt(np.maximum(variances, _MIN_VARIANCE))
    scaled = covariance / (scale[:, :, None] * scale[:, None, :])
    return np.asarray(scale[:, :, None] * np.linalg.cholesky(scaled + _REGULARIZATION * np.eye(3)))


def pose_covariance(poses: FloatArray, horizon: FloatArray, covariance: FloatArray) -> FloatArray:
    """
    Return the covariance (h, 3, 3) of x, y and heading at the steps, SI, from an exact start.

    `poses` (h, 3) of `pose_horizon`, `horizon` (h, 3) velocities, `covariance` (h, 3, 3) of them.
    """
    root = _root(covariance)
    cos, sin = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    v_x, v_y = horizon[:, 0, None], horizon[:, 1, None]
    heading = _TICK_S * np.cumsum(root[:, 2], axis=0)
    x_rate = cos * root[:, 0] - sin * root[:, 1] - (v_x * sin + v_y * cos) * heading
    y_rate = sin * root[:, 0] + cos * root[:, 1] + (v_x * cos - v_y * sin) * heading
    errors = np.stack(
        [_TICK_S * np.cumsum(x_rate, axis=0), _TICK_S * np.cumsum(y_rate, axis=0), heading], axis=1
    )
    return np.asarray(errors @ errors.transpose(0, 2, 1))
