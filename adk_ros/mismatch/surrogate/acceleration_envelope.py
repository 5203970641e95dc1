# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The accelerations that a simulation reaches: beyond them a surrogate is not known.

Tyres are linear for small forces and saturate at large ones. Where a recording is driven harder
than the simulation, the surrogate extrapolates, and what it gets wrong there looks like missing
physics. Such driving is where both the measured and the simulated acceleration lie outside the
convex hull of the simulated ones in the plane of a_x and a_y (the g-g diagram: D. L. Milliken,
W. F. Milliken, "Race Car Vehicle Dynamics", 1995, chapter 9). Both, since missing physics may move
either of them alone: a power limit lowers the measured one, a phantom braking the simulated one.

With the friction of the road all forces of a tyre at given slip over peak slip shrink in
proportion: on a slippery road the hull shrinks with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from adk_ros.mismatch.library.criteria import SETTLING_S
from adk_ros.mismatch.surrogate.residuals import BIN_S, STEP_S, ResidualProblem
from adk_ros.mismatch.surrogate.state_index import A_X, A_Y
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.differentiation import SMOOTHING_WINDOW_S, savitzky_golay

_ROUNDING = 1e-6
"""m/s², of the vertices in a file."""


@dataclass(frozen=True)
class AccelerationEnvelope:
    """Convex hull of accelerations: `vertices` (k, 2), a_x and a_y in m/s²."""

    vertices: FloatArray

    @classmethod
    def of(cls, accelerations: FloatArray) -> AccelerationEnvelope | None:
        """Return the hull of accelerations (n, 2), or None where they span no area."""
        if len(accelerations) < 3:
            return None
        try:
            hull = ConvexHull(accelerations)
        except (QhullError, ValueError):
            return None
        return cls(accelerations[hull.vertices])

    def excludes(self, accelerations: FloatArray) -> BoolArray:
        """Return which of the accelerations (n, 2) lie outside."""
        sides = ConvexHull(self.vertices).equations
        outside = accelerations @ sides[:, :2].T + sides[:, 2]
        return np.asarray((outside > _ROUNDING).any(axis=1))

    def bins_beyond(
        self, problem: ResidualProblem, out: FloatArray, friction: FloatArray
    ) -> BoolArray:
        """
        Return the bins (b,) of a recording beyond the simulation, and those that they influence.

        `out`: the surrogate's run along the recording; `friction` (b,): of the road, relative to
        the simulation's. Smoothing spreads a measurement by half of its window, and the surrogate
        settles afterwards.
        """
        beyond = self.excludes(simulated_accelerations(problem, out) / friction[:, None])
        beyond &= self.excludes(_measured_accelerations(problem) / friction[:, None])
        before = np.ones(round(0.5 * SMOOTHING_WINDOW_S / BIN_S) + 1)
        after = np.ones(round(SETTLING_S / BIN_S) + 1)
        spread = np.convolve(beyond[::-1], before)[: problem.bins][::-1] > 0.0
        spread |= np.convolve(beyond, after)[: problem.bins] > 0.0
        return np.asarray(spread)


def simulated_accelerations(problem: ResidualProblem, out: FloatArray) -> FloatArray:
    """Return the simulated a_x and a_y (bins, 2) of a run `out`."""
    return np.column_stack([problem.binned(out[A_X]), problem.binned(out[A_Y])])


def _measured_accelerations(problem: ResidualProblem) -> FloatArray:
    """Return the smoothed a_x and a_y (bins, 2): of the IMU, or of the odometry without one."""
    log = problem.log
    if log.imu_s.size:
        columns = [
            savitzky_golay(np.interp(problem.middle_s, log.imu_s, log.imu[:, i]), STEP_S)
            for i in (0, 1)
        ]
    else:
        v_x, v_y, yaw_rate = problem.smoothed_odometry.T
        columns = [
            np.gradient(v_x, STEP_S) - yaw_rate * v_y,
            np.gradient(v_y, STEP_S) + yaw_rate * v_x,
        ]
    return np.column_stack([problem.binned(np.ascontiguousarray(x)) for x in columns])
