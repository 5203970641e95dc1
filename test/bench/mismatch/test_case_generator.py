# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cases of our own: what is concealed is there, and only where the label says."""

from __future__ import annotations

import numpy as np

from adk_ros.bench.mismatch.sensor_faults import simulate_faulty_sensors

BIAS = {"imu_bias": {"ax": 0.2, "ay": -0.1, "gyro": 0.01}}


def test_a_bias_begins_at_its_onset() -> None:
    truth, commands = np.zeros((4001, 11)), np.zeros((161, 2))
    said = simulate_faulty_sensors("still", truth, commands, BIAS, None, onset_s=1.5)
    late = said.imu_s >= 1.5
    assert 0 < late.sum() < late.size
    np.testing.assert_array_equal(said.imu[~late], 0.0)
    np.testing.assert_allclose(said.imu[late], np.tile([0.2, -0.1, 0.01], (late.sum(), 1)))
    always = simulate_faulty_sensors("still", truth, commands, BIAS, None)
    np.testing.assert_allclose(always.imu[0], [0.2, -0.1, 0.01])
