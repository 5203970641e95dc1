# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which drives count as spun."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.plant.scenario.random_routes import spins


@pytest.mark.parametrize(
    ("lateral", "spun"),
    [([0.1, -0.4], False), ([0.1, -30.0], True), ([0.1, np.nan], True), ([0.1, np.inf], True)],
)
def test_a_drive_that_ends_in_no_number_has_spun(lateral: list[float], spun: bool) -> None:
    assert spins(np.array([0.2, 0.3]), np.array(lateral)) is spun
