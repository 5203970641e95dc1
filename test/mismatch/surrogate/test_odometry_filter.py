# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The low-pass filter of odometry's yaw rate, as the residuals of a surrogate model apply it."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.mismatch.surrogate import residuals
from adk_ros.mismatch.surrogate.residuals import BIN_S, STEP_S, SensorSamples, TimeGrid
from adk_ros.mismatch.surrogate.state_index import (
    N_CHANNELS,
    ODOMETRY_YAW_RATE,
    YAW_ACCELERATION,
    YAW_RATE,
)


@pytest.mark.parametrize("lag_s", [0.0, 0.02, 0.05, 0.2])
def test_a_filtered_yaw_rate_leaves_no_residual(lag_s: float) -> None:
    """Of a continuous first-order filter of a sine: an error of 5 ms would leave 0.03 of it."""
    n, omega = 2000, 6.0
    middle_s = STEP_S * (np.arange(n) + 0.5)
    out = np.zeros((YAW_ACCELERATION + 1, n))
    out[YAW_RATE] = np.sin(omega * middle_s)
    sensors = np.zeros((9, n))
    sensors[residuals._GYRO_GAIN : residuals._ODOMETRY_LAG] = 1.0
    sensors[residuals._ODOMETRY_LAG] = lag_s
    stamps = np.arange(2.0, n * STEP_S - 1.0, 0.02) + 0.003
    published = np.zeros((stamps.size, 3))
    phase = np.arctan(omega * lag_s)
    published[:, 2] = np.cos(phase) * np.sin(omega * stamps - phase)
    bins = (stamps / BIN_S).astype(np.int64)
    odometry = SensorSamples(stamps, published, bins)
    imu = SensorSamples(np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=np.int64))
    total = np.zeros((N_CHANNELS, int(n * STEP_S / BIN_S) + 1))
    residuals._sum_residuals(out, sensors, TimeGrid(0.0, STEP_S), imu, odometry, total)
    # A bin has two samples.
    assert np.abs(total[ODOMETRY_YAW_RATE]).max() < 2.0 * 0.001
