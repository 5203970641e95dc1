# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sensor models of generated cases: injected faults, noise and lost messages."""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.injection.injected_changes import STEPS_PER_COMMAND

NOISE = np.array([0.06, 0.06, 0.003])
"""Standard deviation of the IMU: a_x, a_y in m/s², yaw rate in rad/s."""
ODOMETRY_NOISE = np.array([0.03, 0.03, 0.003, 0.03, 0.03, 0.003])
"""Standard deviation of v_x, v_y (m/s), yaw rate (rad/s), x, y (m), heading (rad)."""
_DROPOUT = 0.002
"""Probability that a message is lost."""


def simulate_faulty_sensors(
    name: str,
    truth: FloatArray,
    commands: FloatArray,
    effects: dict[str, dict[str, float]],
    rng: np.random.Generator | None,
    noise: float = 1.0,
    onset_s: float = 0.0,
) -> SensorLog:
    """
    Simulate the sensors of a drive; noise and lost messages only with a generator.

    `truth` (n, TRUTH), `commands` (m, 2) as of `simulate_injected_drive`; `noise` is a factor. An
    IMU bias acts from `onset_s` on.
    """
    n = truth.shape[0]
    imu_at, odometry_at = np.arange(5, n, 10), np.arange(5, n, 20)
    delay = effects.get("imu_delay", {}).get("delay", 0.0)
    delayed = np.maximum(imu_at - round(1000.0 * delay), 0)
    imu = truth[delayed][:, [0, 1, 2]].copy()
    arm = effects.get("imu_lever_arm", {"x": 0.0, "y": 0.0})
    rate, yaw_accel = truth[delayed, 2], truth[delayed, 10]
    imu[:, 0] -= rate**2 * arm["x"] + yaw_accel * arm["y"]
    imu[:, 1] += yaw_accel * arm["x"] - rate**2 * arm["y"]
    imu[:, 2] *= effects.get("gyro_scale", {}).get("scale", 1.0)
    bias = effects.get("imu_bias", {"ax": 0.0, "ay": 0.0, "gyro": 0.0})
    imu[0.001 * imu_at >= onset_s] += np.array([bias["ax"], bias["ay"], bias["gyro"]])
    tilt = effects.get("imu_tilt", {"roll": 0.0, "pitch": 0.0})
    imu[:, 0] -= GRAVITY * np.sin(tilt["pitch"])
    imu[:, 1] += GRAVITY * np.sin(tilt["roll"])
    rates = truth[:, 2].copy()
    tau = effects.get("odometry_filter", {}).get("tau", 0.0)
    if tau > 0.0:
        keep = np.exp(-0.001 / tau)
        for k in range(1, n):
            rates[k] = rates[k] + (rates[k - 1] - rates[k]) * keep
    odometry = np.column_stack([truth[odometry_at, 3], truth[odometry_at, 4], rates[odometry_at]])
    odometry[:, 0] *= effects.get("odometry_scale", {}).get("scale", 1.0)
    pose = truth[odometry_at][:, [5, 6, 7]].copy()
    imu_s: FloatArray = 0.001 * imu_at.astype(np.float64)
    odometry_s: FloatArray = 0.001 * odometry_at.astype(np.float64)
    if rng is not None:
        imu += noise * NOISE * rng.standard_normal(imu.shape)
        both = noise * ODOMETRY_NOISE * rng.standard_normal((odometry.shape[0], 6))
        odometry += both[:, :3]
        pose += both[:, 3:]
        imu_kept = rng.random(imu_s.size) > _DROPOUT
        odometry_kept = rng.random(odometry_s.size) > _DROPOUT
        imu_s, imu = imu_s[imu_kept], imu[imu_kept]
        odometry_s, pose = odometry_s[odometry_kept], pose[odometry_kept]
        odometry = odometry[odometry_kept]
    command_s: FloatArray = (
        0.001 * STEPS_PER_COMMAND * np.arange(commands.shape[0], dtype=np.float64)
    )
    return SensorLog(
        name, 0.001 * (n - 1), imu_s, imu, odometry_s, odometry, pose, command_s, commands
    )
