# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Error covariances that a predictor starts with: those of validation, or typical increments."""

from __future__ import annotations

import numpy as np

from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.uncertainty.rollout_monitor import RolloutMonitor
from adk_ros.numerics.arrays import FloatArray

PRIOR_ROLLOUTS = 5.0
"""
Weight of the validation covariance, in rollouts: 1.25 s of driving. Empirical, not calibrated.
"""


def one_step_errors(model: KoopmanModel) -> FloatArray:
    """Return the initial covariance (3, 3) of the innovation, SI."""
    if len(model.horizon_covariance):
        return np.array(model.horizon_covariance[0])
    return np.diag(_typical_increment_squared(model))


def held_input_errors(model: KoopmanModel, steps: int) -> FloatArray:
    """
    Return the initial covariance (steps, 3, 3), SI, of a horizon under constant commands.

    It is the model's, the last row repeated for a longer horizon. A model without one starts with
    the variance of as many typical increments as there are steps.
    """
    for table in (model.held_input_covariance, model.horizon_covariance):
        if len(table):
            return np.asarray(table[np.minimum(np.arange(steps), len(table) - 1)])
    increment = np.diag(_typical_increment_squared(model))
    return np.asarray(increment * np.arange(1, steps + 1)[:, None, None])


def tick_change(model: KoopmanModel) -> FloatArray:
    """Return the RMS change (3,) of the state over one tick, SI, on validation data if known."""
    if len(model.mean_square_change):
        return np.asarray(np.sqrt(model.mean_square_change[0]))
    return np.asarray(np.sqrt(_typical_increment_squared(model)))


def monitored_steps(model: KoopmanModel) -> int:
    """Return the steps of monitored rollouts, 0 if there are none: see `make_rollout_monitor`."""
    if model.lifting.compiled is None or not model.relift or not len(model.mean_square_change):
        return 0
    return len(model.horizon_covariance) or len(model.mean_square_change)


def make_rollout_monitor(model: KoopmanModel) -> RolloutMonitor | None:
    """Return a monitor, or None if the model is not lifted by a compiled encoder at each step."""
    encoder = model.lifting.compiled
    if encoder is None or not monitored_steps(model):
        return None
    scale = model.scaling.x_scale
    change = model.mean_square_change / scale**2
    errors = change[:, :, None] * np.eye(3)
    if len(model.horizon_covariance):
        errors = model.horizon_covariance / np.outer(scale, scale)
    form = model.step_form()
    return RolloutMonitor(encoder, form, errors, PRIOR_ROLLOUTS)


def _typical_increment_squared(model: KoopmanModel) -> FloatArray:
    return np.square(model.scaling.x_scale * model.scaling.step_scale)
