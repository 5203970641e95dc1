# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the surrogate's error feigns as an effect of all cars.

The scores of the simulation about itself (`fleet_simulation`) show the error of the surrogate on
the road that it was identified on. The cars of a fleet drive on other roads, and there it errs in
a way that is the same for all of them: fleets in which nothing acts, of two plants' cars and of
drives of different length, all say less downforce and more rotating inertia than the simulation
has. So the size of an effect of all cars has a systematic deviation that no number of recordings
lowers; differences between cars, conditions and times are free of it. `scripts/
fleet_shared_error.py` measures it with the plant of 14 degrees of freedom; for another simulator
it is a lower bound.
"""

from __future__ import annotations

from collections.abc import Mapping

from adk_ros.mismatch.library.criteria import SYSTEMATIC_ERROR_PER_MATERIALITY

SHARED_ERROR: Mapping[str, float] = {
    "aero_downforce.cla": 2.8,
    "rotating_inertia.inertia": 2.6,
    "load_sensitivity.slope": 0.6,
    "low_friction.mu_scale": 0.56,
    "yaw_inertia.scale": 0.5,
    "aero_drag.cda": 0.29,
    "rear_wheel_steer.ratio": 0.26,
    "payload.mass": 0.23,
    "cg_shift.shift": 0.18,
    "rear_tyre_stiffness.scale": 0.16,
    "imu_lever_arm.x": 0.15,
    "steering_ratio.scale": 0.15,
}
"""
Parameter -> standard deviation in materiality thresholds: root mean square over `FLEETS` fleets.
Below `criteria.SYSTEMATIC_ERROR_PER_MATERIALITY`, that counts.
"""
REMAINING_ERROR: Mapping[str, float] = {
    "aero_downforce.cla": 0.66,
    "rotating_inertia.inertia": 0.39,
    "cg_shift.shift": 0.13,
    "load_sensitivity.slope": 0.12,
    "yaw_inertia.scale": 0.11,
}
"""The same where a further drive of the simulation on each route shows that error."""
FLEETS = 16
"""Fleets that the deviations were measured on."""


def shared_error(key: str) -> float:
    """Return the systematic deviation of a parameter in all cars, in materiality thresholds."""
    return max(SHARED_ERROR.get(key, 0.0), SYSTEMATIC_ERROR_PER_MATERIALITY)


def remaining_error(key: str) -> float:
    """Return the same deviation where further drives of the simulation show the error."""
    return max(REMAINING_ERROR.get(key, 0.0), SYSTEMATIC_ERROR_PER_MATERIALITY)
