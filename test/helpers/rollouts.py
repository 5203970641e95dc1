# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Models of every form that a rollout has, adapted, and candidate commands."""

from collections.abc import Callable

import numpy as np

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.model.uncertainty.fallback import Fallback
from helpers.model import Array, fold, inputs, make_model, paper_model, slalom

MONITORED = np.ones((80, 3))


def fallback() -> Fallback:
    """Weights of all naive predictors, other ones for known and held commands."""
    return Fallback(np.random.default_rng(1).uniform(0.0, 0.3, (2, 3, 30, 3)))


MODELS: dict[str, Callable[[], KoopmanModel]] = {
    "monitored": lambda: make_model(mean_square_change=MONITORED),
    "without history": lambda: make_model(mean_square_change=MONITORED, history=0),
    "long history": lambda: make_model(history=5, features=7),
    "not residual": lambda: make_model(residual=False, affine=False),
    "limits": lambda: make_model(motion_limits=np.array([2.0, 1.0, 0.5, 4.0])),
    "naive": lambda: make_model(mean_square_change=MONITORED, fallback=fallback()),
    "TorchScript": lambda: make_model(compiled=False, fallback=fallback()),
    "recursive": lambda: make_model(online=OnlineSettings("ffrls")),
    "single-track": lambda: make_model(features=8, is_quadratic=True),
    "single-track only": lambda: make_model(history=5, features=7, is_quadratic=False),
    "paper": paper_model,
    "paper, naive": lambda: paper_model(fallback=fallback()),
}


def adapted(model: KoopmanModel, ticks: int = 90, seed: int = 0) -> Predictor:
    predictor = Predictor(model, horizon_steps=0)
    fold(predictor, slalom(ticks, seed))
    return predictor


def candidates(count: int, steps: int, seed: int = 3) -> Array:
    return np.array([inputs(steps, seed + k) for k in range(count)]).reshape(count, steps, 2)
