# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Features step by step equal those of a whole drive."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.mismatch.deployment.feature_history import FeatureHistory
from adk_ros.mismatch.library.features import feature_matrix

STEP = 0.025
TIME = STEP * np.arange(1200)
SIGNALS = {
    "time": TIME,
    "v_x": 15.0 + 3.0 * np.sin(0.2 * TIME),
    "v_y": np.zeros_like(TIME),
    "yaw_rate": np.zeros_like(TIME),
    "a_x": np.zeros_like(TIME),
    "a_y": 2.0 * np.sin(1.3 * TIME),
    "torque": 300.0 * np.sin(0.5 * TIME),
    "delta": np.zeros_like(TIME),
}


@pytest.mark.parametrize(
    "names",
    [
        ["speed_squared", "gate:drive_torque:lateral_size>1.5"],
        ["lag:torque:0.5", "resonance:a_y:0.5:0.2", "hysteresis:a_y:0.4"],
        ["drift:brake_torque:brake_work:3e4", "heat:brake_torque:10", "lag:a_y:0.5"],
    ],
)
def test_features_step_by_step_equal_those_of_the_drive(names: list[str]) -> None:
    history = FeatureHistory(names)
    steps = [
        history.after({key: float(x[k]) for key, x in SIGNALS.items()}) for k in range(TIME.size)
    ]
    whole = feature_matrix(names, SIGNALS)
    scale = np.abs(whole).max(axis=0)
    # Before 20 s the history is complete; after it, features with a memory have forgotten.
    np.testing.assert_allclose(np.vstack(steps)[:800] / scale, whole[:800] / scale, atol=1e-6)
    np.testing.assert_allclose(np.vstack(steps) / scale, whole / scale, atol=0.05)
