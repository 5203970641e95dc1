# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a simulation, before anything is recorded: what a recording of such driving would show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adk_ros.mismatch.inference.detectability import Drive
from adk_ros.mismatch.inference.detectable_sizes import active_effect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.recording.checks import check_recording, check_vehicle
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.lap import find_lap
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.scenario.sensors import Imu, Odometry


def typical_noise() -> FloatArray:
    """Return the noise of a sample (6,) by channel of the sensors that `adk simulate` assumes."""
    imu, odometry = Imu(), Odometry()
    return np.array(
        [imu.accel_noise] * 2
        + [imu.gyro_noise]
        + [odometry.velocity_noise] * 2
        + [odometry.yaw_rate_noise]
    )


def planned_drive(
    simulation: SensorLog,
    nominal: NominalVehicle | None = None,
    noise: FloatArray | None = None,
    surrogate: SurrogateModel | None = None,
) -> Drive:
    """
    Return the drive of a simulation with the sensors of a recording.

    `noise` (6,) of a sample by channel, default `typical_noise`; `surrogate`: that of the
    simulation, if it is identified already.

    :raises DataError: the simulation does not allow an analysis.
    """
    if nominal is not None:
        simulation = replace(simulation, length_scale=nominal.length_scale)
    check_recording(simulation)
    if nominal is not None:
        check_vehicle(nominal, simulation)
    if surrogate is None:
        surrogate, _ = surrogate_of(simulation, simulation, nominal, lambda done, text: None)
    problem = prepare_residual_problem(simulation, typical_noise() if noise is None else noise)
    return Drive.of(Likelihood.of(problem, surrogate), find_lap(problem))


def is_detectable(drive: Drive, effect: str, values: dict[str, float], minutes: float) -> bool:
    """
    Whether an effect of this size would be named after `minutes` of such driving.

    `values` by parameter, in the catalogue's units; parameters that are left out are neutral. An
    effect that can only act at a place is assumed on a quarter of the lap.
    """
    return drive.is_detectable(
        active_effect(drive.full.likelihood.effects[effect], values, drive.lap), minutes
    )
