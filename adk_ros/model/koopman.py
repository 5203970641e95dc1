# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a model is: all that training yields and a predictor needs. No clock, no files, no ROS."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.lifting.encoder import Lifting
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class KoopmanModel:
    """
    What training yields, all that a predictor needs.

    `theta0` (n_z, n_phi): offline [A0 B0 c0] (`affine`) or [A0 B0]; in the residual form its rows
    give increments, the state's in units of `scaling.step_scale`. `horizon_covariance`
    (steps, 3, 3): error covariance in SI units by horizon, on data not trained on, and
    `usual_change` (steps, 3) the mean square change of the state over it; both empty where there
    are none. `held_covariance`: as the former, under held commands; if empty, that one serves.
    `relift`: lift anew at each step of a roll-out, else stay in the lifted space.
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

    @property
    def n_z(self) -> int:
        """Size of the lifted state."""
        return int(self.theta0.shape[0])
