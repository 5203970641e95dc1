# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The deep Koopman model that training produces and the predictor runs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.lifting.encoder import Lifting
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.uncertainty.compiled_rollout import StepForm
from adk_ros.model.uncertainty.fallback import Fallback
from adk_ros.model.uncertainty.motion_limits import step_bounds
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class KoopmanModel:
    """
    A trained model.

    `theta0` (n_z, n_phi): offline [A0 B0 c0] (`affine`) or [A0 B0]. In the `residual` form its
    rows predict increments, those of the state in units of `scaling.step_scale`. `history`: past
    samples. `relift`: lift anew at each step of a rollout; otherwise the rollout stays in the
    lifted space.

    By horizon step, SI, on validation data: `horizon_covariance` (steps, 3, 3), error covariance
    under known commands; `held_input_covariance` (steps, 3, 3), under constant commands;
    `mean_square_change` (steps, 3) of the state. `motion_limits` (4,): see there. Each is empty if
    unknown. `fallback`: the naive predictors that take over.
    """

    lifting: Lifting
    scaling: Scaling
    theta0: FloatArray
    history: int
    residual: bool
    affine: bool
    relift: bool
    observer_gains: ObserverGains
    horizon_covariance: FloatArray
    mean_square_change: FloatArray
    uses_imu: bool
    online: OnlineSettings = field(default_factory=OnlineSettings)
    held_input_covariance: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    motion_limits: FloatArray = field(default_factory=lambda: np.zeros(0))
    fallback: Fallback = field(default_factory=Fallback.none)

    @property
    def n_z(self) -> int:
        """Return the size of the lifted state."""
        return int(self.theta0.shape[0])

    def step_form(self) -> StepForm:
        """Return how a step of a rollout uses what the model predicts."""
        return StepForm(
            n_x=3 * (self.history + 1),
            residual=self.residual,
            step_scale=np.ascontiguousarray(self.scaling.step_scale, dtype=np.float64),
            gains=self.observer_gains.table(),
            bounds=step_bounds(self.motion_limits, self.scaling),
        )
