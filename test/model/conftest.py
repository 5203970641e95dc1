# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the tests of models."""

from functools import partial

import pytest

from adk_ros.model.uncertainty.published_horizons import PublishedHorizonErrors
from adk_ros.model.uncertainty.rollout_monitor import RolloutMonitor


@pytest.fixture
def unshrunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Predict as the model and the trained weights do, whatever earlier horizons were worth."""
    monkeypatch.setattr(
        "adk_ros.model.predictor.PublishedHorizonErrors",
        partial(PublishedHorizonErrors, shrinks=False),
    )
    monkeypatch.setattr(
        "adk_ros.model.initial_errors.RolloutMonitor",
        partial(RolloutMonitor, learns_weights=False),
    )
