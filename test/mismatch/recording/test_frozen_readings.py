# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Dropouts of sensors: frozen readings are removed, missing ones are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch import steady

from adk_ros.mismatch.inference.counted_bins import unmeasured_bins
from adk_ros.mismatch.recording.frozen_readings import without_frozen_readings
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem


def noisy(resolution: float = 0.0) -> SensorLog:
    log, rng = steady(), np.random.default_rng(3)

    def measured(values: np.ndarray) -> np.ndarray:
        out = values + 0.03 * rng.standard_normal(values.shape)
        return np.round(out / resolution) * resolution if resolution else out

    return replace(log, imu=measured(log.imu), odometry=measured(log.odometry))


def test_a_recording_without_dropouts_stays_as_it_is() -> None:
    log, notes = without_frozen_readings(noisy())
    assert notes == []
    assert log.imu_s.size == 4000


def test_repeated_readings_are_removed_and_named() -> None:
    log = noisy()
    odometry = log.odometry.copy()
    odometry[500:520] = odometry[500]
    odometry[900:950] = odometry[900]
    clean, notes = without_frozen_readings(replace(log, odometry=odometry))
    assert clean.odometry_s.size == log.odometry_s.size - 19 - 49
    assert clean.pose.shape[0] == clean.odometry.shape[0] == clean.odometry_s.size
    assert notes == [
        "odometry repeats its last reading in 2 intervals, 1.3 s in all, the longest 1.0 s, the "
        "first at 10.0 s: a dropout of the sensor, which counts as missing data"
    ]


def test_coarse_resolution_is_no_frozen_sensor() -> None:
    log, notes = without_frozen_readings(noisy(0.1))
    assert notes == []
    assert log.imu_s.size == 4000


def test_a_standing_car_may_have_constant_readings() -> None:
    log = noisy()
    still = replace(log, odometry=np.zeros_like(log.odometry))
    assert without_frozen_readings(still)[0].odometry_s.size == log.odometry_s.size


def test_missing_messages_are_named() -> None:
    log = noisy()
    kept = (log.imu_s < 12.0) | (log.imu_s > 12.5)
    one_lost = np.arange(kept.size) % 97 > 0
    kept &= one_lost
    gapped = replace(log, imu_s=log.imu_s[kept], imu=log.imu[kept])
    _, notes = without_frozen_readings(gapped)
    assert notes == [
        "the IMU is missing in one interval, 0.5 s in all, the longest 0.5 s, the first at 12.0 s:"
        " a dropout of the sensor, which counts as missing data"
    ]


def test_bins_in_a_gap_of_odometry_do_not_count() -> None:
    log = noisy()
    kept = (log.odometry_s < 12.0) | (log.odometry_s > 12.5)
    problem = prepare_residual_problem(
        replace(
            log,
            odometry_s=log.odometry_s[kept],
            odometry=log.odometry[kept],
            pose=log.pose[kept],
        )
    )
    out = problem.bin_s[unmeasured_bins(problem)]
    assert out[0] == pytest.approx(11.8, abs=0.1)
    assert out[-1] == pytest.approx(13.5, abs=0.1)
    assert not unmeasured_bins(prepare_residual_problem(log)).any()
