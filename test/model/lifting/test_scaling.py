# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Channels that the training data hold constant: a change of them must not explode."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.model.lifting.scaling import Scaling


@pytest.mark.parametrize("kind", ["standard", "min_max"])
def test_a_change_of_a_constant_channel_stays_small(kind: str) -> None:
    rng = np.random.default_rng(0)
    x, u = rng.normal(0.0, 1.0, (50, 3)), rng.normal(0.0, 1.0, (50, 2))
    x[:, 1], u[:, 0] = 0.0, 200.0
    scaling = (
        Scaling.standard(x, u, np.diff(x, axis=0)) if kind == "standard" else Scaling.min_max(x, u)
    )
    # A torque of 50 N m more, and the lateral velocity that an accelerometer adds between samples.
    assert abs(scaling.scale_u(np.array([250.0, 0.0]))[0]) < 1e-6
    assert abs(scaling.scale_x(np.array([0.0, 0.02, 0.0]))[1]) < 0.1
    assert np.abs(scaling.scale_u(u)[:, 1]).max() > 0.5
