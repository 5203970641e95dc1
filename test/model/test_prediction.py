# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last check before a prediction is published."""

import numpy as np
import pytest

from adk_ros.model.prediction import Prediction, Status

FIELDS = ("x", "covariance", "horizon", "horizon_covariance")


def prediction(steps: int = 4) -> Prediction:
    return Prediction(
        0, 25_000_000, np.full(3, 1e300), np.full((3, 3), -1e300), np.full((steps, 3), 1e300),
        np.zeros((steps, 3, 3)), np.full(3, np.nan), Status.PREDICTED,
    )  # fmt: skip


def test_large_numbers_and_an_empty_horizon_are_finite() -> None:
    assert prediction().is_finite()
    assert prediction(0).is_finite()


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_value_that_is_not_finite_is_found(field: str, value: float) -> None:
    made = prediction()
    getattr(made, field).flat[-1] = value
    assert not made.is_finite()
