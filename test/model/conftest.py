# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the tests of models."""

from functools import partial

import pytest

from adk_ros.model.uncertainty.published_horizons import PublishedHorizonErrors


@pytest.fixture
def unshrunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Publish horizons as the model predicts them, whatever earlier ones were worth."""
    monkeypatch.setattr(
        "adk_ros.model.predictor.PublishedHorizonErrors",
        partial(PublishedHorizonErrors, shrinks=False),
    )
