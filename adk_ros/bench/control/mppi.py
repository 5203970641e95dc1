# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Model predictive path integral control (MPPI): a weighted mean of sampled commands.

    w_k = exp(-(J_k - min J) / lambda),   u <- u + sum w_k e_k / sum w_k

with e_k normal at nodes of the horizon and linear between them, which keeps commands smooth. The
term of the control cost is left out (alpha = 1). Reference: G. Williams et al., "Information
theoretic MPC for model-based reinforcement learning", ICRA 2017.
"""

from __future__ import annotations

import numpy as np

from adk_ros.bench.control.controllers import ControlSettings, Plan
from adk_ros.bench.control.prediction_models import PredictionModel
from adk_ros.bench.control.tracking_cost import TrackingStart, tracking_costs
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import Route


class Mppi:
    """MPPI along a route; the noise depends on `seed` alone, not on the model."""

    def __init__(self, settings: ControlSettings, route: Route, seed: int) -> None:
        self._settings, self._route = settings, route
        self._plan = Plan(settings, route)
        self._rng = np.random.default_rng(seed)
        self._interpolation = settings.interpolation()

    def next_command(
        self, model: PredictionModel, start: TrackingStart, in_force: FloatArray
    ) -> FloatArray:
        """As `Controller.next_command`."""
        settings = self._settings
        plan = self._plan.shifted(in_force)
        shape = settings.candidates, self._interpolation.shape[1], 2
        noise = self._rng.standard_normal(shape) * np.array(settings.spread)
        # The plan itself is a candidate.
        noise[0] = 0.0
        limits = np.array(settings.limits)
        candidates = plan + np.einsum("sn,knc->ksc", self._interpolation, noise)
        candidates = np.clip(candidates, -limits, limits)
        candidates[:, 0] = in_force
        costs = np.empty(settings.candidates)
        tracking_costs(
            model.roll_out_many(candidates), candidates, start, self._route.table,
            self._route.spacing, settings.weights, costs,
        )  # fmt: skip
        weights = np.exp(-(costs - costs.min()) / settings.temperature)
        return self._plan.keep(np.einsum("k,ksc->sc", weights / weights.sum(), candidates))
