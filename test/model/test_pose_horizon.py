# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses along a horizon, and their covariance."""

import numpy as np

from adk_ros.model.pose_horizon import (
    CarriedPose,
    moved_pose,
    pose_covariance,
    pose_horizon,
)
from adk_ros.numerics.arrays import FloatArray

STEPS = 80
START = np.array([100.0, -20.0, 2.0])
SPEED, RATE = 15.0, 0.4


def circle() -> FloatArray:
    return np.repeat([[SPEED, -0.3, RATE]], STEPS, axis=0)


def test_a_steady_turn_is_a_circle() -> None:
    velocity = circle()[0]
    poses = pose_horizon(START, velocity, circle())
    time_s = 0.025 * np.arange(1, STEPS + 1)
    np.testing.assert_allclose(poses[:, 2], START[2] + RATE * time_s)
    speed = np.hypot(*velocity[:2])
    radius = speed / RATE
    course = START[2] + np.arctan2(velocity[1], velocity[0])
    exact_x = START[0] + radius * (np.sin(course + RATE * time_s) - np.sin(course))
    exact_y = START[1] - radius * (np.cos(course + RATE * time_s) - np.cos(course))
    np.testing.assert_allclose(poses[:, 0], exact_x, atol=1e-3)
    np.testing.assert_allclose(poses[:, 1], exact_y, atol=1e-3)
    np.testing.assert_allclose(moved_pose(START, velocity, 0.025), poses[0])
    np.testing.assert_allclose(moved_pose(poses[0], velocity, -0.025), START)


def test_a_pose_is_carried_along_the_velocities_since() -> None:
    """A car that brakes by 8 m/s² in a turn, 1.4 s after the last pose."""
    tick_ns, carried = 25_000_000, CarriedPose()
    velocities = np.array([[20.0 - 0.2 * k, -0.1, 0.3] for k in range(57)])
    expected = pose_horizon(START, velocities[0], velocities[1:])
    for k, velocity in enumerate(velocities):
        pose = carried.at(k * tick_ns, velocity, 0, START)
        np.testing.assert_allclose(pose, START if not k else expected[k - 1])
    # With the last velocity throughout, it is some metres off.
    assert np.abs(moved_pose(START, velocities[-1], 1.4) - pose).max() > 3.0
    # The next measured pose replaces it; samples before one are moved back from it.
    now_ns = 57 * tick_ns
    for stamp_ns in (now_ns, now_ns + tick_ns, now_ns + 2 * tick_ns):
        pose = carried.at(stamp_ns, velocities[3], now_ns + tick_ns, START)
        after_s = (stamp_ns - now_ns - tick_ns) * 1e-9
        np.testing.assert_allclose(pose, moved_pose(START, velocities[3], after_s))


def test_the_covariance_is_that_of_lasting_errors() -> None:
    """Against poses of horizons that are drawn with errors fully correlated along them."""
    rng = np.random.default_rng(0)
    root = np.array([[0.3, 0.0, 0.0], [0.05, 0.1, 0.0], [0.001, 0.002, 0.01]])
    growth = np.linspace(0.1, 1.0, STEPS)[:, None, None]
    covariance = np.broadcast_to(root @ root.T, (STEPS, 3, 3)) * growth**2
    horizon = circle()
    poses = pose_horizon(START, horizon[0], horizon)
    found = pose_covariance(poses, horizon, covariance)
    drawn = []
    for w in rng.normal(size=(4000, 3)):
        errors = (growth * root) @ w
        drawn.append(pose_horizon(START, horizon[0], horizon + errors) - poses)
    for step in (9, 39, 79):
        expected = np.cov(np.array(drawn)[:, step].T)
        np.testing.assert_allclose(
            np.sqrt(np.diag(found[step])), np.sqrt(np.diag(expected)), rtol=0.08
        )
    assert (np.linalg.eigvalsh(found[1:]) > -1e-12).all()


def test_a_singular_covariance_has_poses() -> None:
    """A channel that is always zero has no error, and a lasting error vector is of rank one."""
    horizon = circle()
    poses = pose_horizon(START, horizon[0], horizon)
    error = np.array([0.01, 0.001, 0.0005])
    for covariance in (np.diag([1e-3, 0.0, 1e-5]), np.outer(error, error), np.zeros((3, 3))):
        every = np.broadcast_to(covariance, (STEPS, 3, 3))
        found = pose_covariance(poses, horizon, every)
        assert np.isfinite(found).all()
        slightly = every + 1e-12 * np.eye(3)
        np.testing.assert_allclose(
            found, pose_covariance(poses, horizon, slightly), rtol=1e-3, atol=1e-7
        )
