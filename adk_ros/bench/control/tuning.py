# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Choice of the controllers' parameters: a grid on a development set, the same for all models.

The development set is the nominal car with another seed. Parameters are scored by the lateral
error averaged over the models that can complete it in time: the kinematic bicycle leaves the road
with all of them, and the plant takes hours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adk_ros.bench.control.cars import NOMINAL
from adk_ros.bench.control.control_bench import ControlPlan, run_one
from adk_ros.bench.control.controllers import MPC_NAME, MPPI_NAME, ControlSettings
from adk_ros.bench.control.linear_mpc import has_osqp
from adk_ros.bench.control.scores import ADAPTED, DYNAMIC, FROZEN

DEVELOPMENT_SEED = 98
_LENGTH_M = 200.0
"""Of the scored part, at most: all of the lane change, and the first bends of the lap."""
_MODELS = (DYNAMIC, FROZEN, ADAPTED)


class Tried(NamedTuple):
    """Parameters in words, and the RMS lateral errors, m, by model."""

    controller: str
    text: str
    errors: dict[str, float]

    @property
    def mean(self) -> float:
        """Mean over the models, m."""
        return float(np.mean(list(self.errors.values())))


def _grid() -> Iterator[tuple[str, str, ControlSettings]]:
    base = ControlSettings()
    for temperature in (0.01, 0.05, 0.2):
        for spread in ((300.0, 0.007), (300.0, 0.015), (600.0, 0.03)):
            text = f"temperature {temperature:g}, spread {spread[0]:g} N·m, {spread[1]:g} rad"
            yield MPPI_NAME, text, replace(base, temperature=temperature, spread=spread)
    if not has_osqp():
        return
    for change in (0.007, 0.02, 0.06):
        weights = base.weights._replace(delta_change=change)
        yield MPC_NAME, f"change of delta {change:g} rad", replace(base, weights=weights)


def tune(
    plan: ControlPlan, progress: Callable[[float, float, str], None] | None = None
) -> list[Tried]:
    """Return all parameters of the grid with their errors on the development set."""
    tried = []
    grid = list(_grid())
    for done, (controller, text, settings) in enumerate(grid):
        if progress is not None:
            progress(done, len(grid), f"{controller}, {text}")
        one = replace(
            plan, settings=settings, cars=(NOMINAL,), controllers=(controller,), models=_MODELS,
            seeds=(DEVELOPMENT_SEED,), length_m=min(plan.length_m, _LENGTH_M),
        )  # fmt: skip
        errors: dict[str, list[float]] = {}
        for choice in one.runs():
            errors.setdefault(choice.model, []).append(run_one(one, choice).score.lateral_rms)
        means = {model: float(np.mean(values)) for model, values in errors.items()}
        tried.append(Tried(controller, text, means))
    return tried
