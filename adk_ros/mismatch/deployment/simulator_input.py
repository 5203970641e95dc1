# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A simulator given as a file instead of a recording: a vehicle's YAML, or a surrogate's.

A vehicle (the 7-DoF model of `adk simulate`) is simulated noise-free at the recording's speed and
acceleration levels, and the result is analysed like a simulator's bag. A surrogate (an earlier
report's `simulation.yaml`) is used as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.surrogate_file import is_surrogate_file, load_surrogate
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.differentiation import savitzky_golay
from adk_ros.numerics.similarity import time_scale
from adk_ros.plant.scenario.driver import Excitation, SpeedPlan
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario
from adk_ros.plant.scenario.sensor_simulation import START_NS, SimulatedDrive
from adk_ros.plant.scenario.sensors import Command, Imu, Odometry, Sensors
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle
from adk_ros.signals.channels import Source

DURATION_S = 180.0
_SCENARIO = "handling"
_REFERENCE_MASS = 2000.0
"""kg, of the car that the scenario's torque excitation is meant for."""
_ENVELOPE_MARGINS = (1.25, 1.1, 0.95, 0.8)
"""
Factors on the recording's accelerations, tried until the car does not spin: the simulation must
cover the recording, but a spin carries no usable information.
"""
_MAX_SIDESLIP = 0.35
"""rad. A larger sideslip is a spin."""
_MIN_SIDESLIP_SPEED = 3.0
"""m/s, below which sideslip is computed with this speed."""
_EXTREME_PERCENTILE = 99.0
_SPEED_RANGE = (5.0, 90.0)
_LATERAL_RANGE = (1.0, 20.0)
_FORWARD_RANGE = (0.5, 10.0)
_BRAKING_RANGE = (0.5, 12.0)
"""Limits of a recording's envelope, m/s and m/s²: beyond, the estimate is noise."""
_TOP_SPEED_FACTOR, _MAX_TOP_SPEED = 1.05, 80.0
_MAX_LATERAL = 12.0
_PLAN_FORWARD_RANGE = (1.0, 8.0)
_PLAN_BRAKING_RANGE = (1.0, 10.0)
"""Limits of a speed plan, m/s and m/s²."""
_SIZE_RANGE = (0.4, 50.0)
"""Scale of the route: its tightest bend has a radius of 16 m, and none may be below 6 m."""


@dataclass(frozen=True)
class DrivingEnvelope:
    """A recording's top speed, m/s, and accelerations, m/s² (99th percentiles)."""

    top: float
    lateral: float
    forward: float
    braking: float


def is_simulator_file(path: Path) -> bool:
    """Whether a simulation is given as a YAML file."""
    return path.suffix in {".yaml", ".yml"}


def driving_envelope(recording: SensorLog, length_scale: float = 1.0) -> DrivingEnvelope:
    """
    Return the speed and accelerations that a recording exceeds 1 % of the time.

    The speed is that of the full-size car with the Froude number of a vehicle at `length_scale`.
    """
    log = recording
    v_x, rate = (savitzky_golay(log.odometry[:, i], log.odometry_period_s) for i in (0, 2))
    acceleration = np.gradient(v_x, log.odometry_s)
    high, low = _EXTREME_PERCENTILE, 100.0 - _EXTREME_PERCENTILE
    return DrivingEnvelope(
        top=float(np.clip(np.percentile(v_x, high) / time_scale(length_scale), *_SPEED_RANGE)),
        lateral=float(np.clip(np.percentile(np.abs(v_x * rate), high), *_LATERAL_RANGE)),
        forward=float(np.clip(np.percentile(acceleration, high), *_FORWARD_RANGE)),
        braking=float(np.clip(-np.percentile(acceleration, low), *_BRAKING_RANGE)),
    )


def load_simulator(path: Path) -> Vehicle | SurrogateModel:
    """
    Load a simulator's file.

    Raises `UsageError`, one line naming the file and the key; also for a surrogate with terms
    identified from a recording, since those are not the simulator's.
    """
    if not path.is_file():
        raise UsageError(f"{path} does not exist: give a bag, a vehicle's YAML or a surrogate's")
    if not is_surrogate_file(path):
        return load_vehicle(path)
    content = load_surrogate(path).content
    if content.terms or content.feature_terms:
        raise UsageError(
            f"{path}: it has terms that were identified from a recording: give the "
            "simulation.yaml in the same folder"
        )
    return content.surrogate()


def simulate_matched_drive(
    vehicle: Vehicle, recording: SensorLog, name: str = "simulation"
) -> SensorLog:
    """
    Return the noise-free sensor log of a vehicle driven at a recording's speed and accelerations.

    The route is the packaged handling course, scaled so that the recording's speed gives its
    lateral acceleration. Raises `UsageError` for a vehicle that cannot drive it.
    """
    envelope = driving_envelope(recording, vehicle.length_scale)
    slowest = _MIN_SIDESLIP_SPEED * time_scale(vehicle.length_scale)
    for margin in _ENVELOPE_MARGINS:
        log = _simulate(vehicle, envelope, margin, name)
        v_x, v_y = log.odometry[:, 0], log.odometry[:, 1]
        if np.all(np.abs(v_y) < np.tan(_MAX_SIDESLIP) * np.maximum(v_x, slowest)):
            break
    return log


def _simulate(vehicle: Vehicle, envelope: DrivingEnvelope, margin: float, name: str) -> SensorLog:
    base = load_scenario(_SCENARIO)
    lateral = min(margin * envelope.lateral, _MAX_LATERAL)
    top = min(_TOP_SPEED_FACTOR * envelope.top, _MAX_TOP_SPEED)
    size = (top / base.speed.top) ** 2 * base.speed.lateral_accel / lateral
    size = float(np.clip(size, *_SIZE_RANGE))
    # A scenario is scaled to a scale model as a whole.
    mass_ratio = vehicle.mass / _REFERENCE_MASS if vehicle.length_scale == 1.0 else 1.0
    scenario = Scenario(
        name=name,
        plant="seven_dof",
        vehicle=base.vehicle,
        duration_s=DURATION_S,
        seed=1,
        route=[type(part).model_validate(_scaled(part.model_dump(), size)) for part in base.route],
        speed=SpeedPlan(
            top=top,
            lateral_accel=lateral,
            variation=0.05,
            accel=float(np.clip(margin * envelope.forward, *_PLAN_FORWARD_RANGE)),
            brake=float(np.clip(margin * envelope.braking, *_PLAN_BRAKING_RANGE)),
        ),
        excitation=Excitation(
            steer=0.003, torque=150.0 * mass_ratio, torque_step=200.0 * mass_ratio
        ),
        sensors=Sensors(
            imu=Imu(rate_hz=100.0, phase_s=0.005),
            odometry=Odometry(rate_hz=50.0, phase_s=0.005),
            command=Command(rate_hz=40.0),
        ).clean(),
        vehicle_changes=vehicle.model_dump(exclude={"name"}),
    )
    return sensor_log_of(simulate(validate(name, scenario.model_dump(), Scenario)))


def sensor_log_of(drive: SimulatedDrive) -> SensorLog:
    """Return the sensor log of a simulated drive, as it would be read from its bag."""
    stamps, values = {}, {}
    for source, stream in drive.streams.items():
        stamps[source], values[source] = _seconds(stream.stamp_ns), stream.values
    odometry = values[Source.ODOMETRY]
    pose = odometry[:, 3:6].copy()
    pose[:, 2] = np.unwrap(pose[:, 2])
    log = SensorLog(
        drive.name,
        float(_seconds(drive.stamp_ns)[-1]),
        stamps[Source.IMU],
        values[Source.IMU],
        stamps[Source.ODOMETRY],
        np.ascontiguousarray(odometry[:, :3]),
        pose,
        stamps[Source.COMMAND],
        values[Source.COMMAND],
    )
    if drive.attitude is None:
        return log
    stamps_s = _seconds(drive.attitude.stamp_ns)
    return replace(log, attitude_s=stamps_s, attitude=drive.attitude.values)


def _seconds(stamp_ns: IntArray) -> FloatArray:
    return np.asarray((stamp_ns - START_NS) * 1e-9, dtype=np.float64)


def _scaled(part: dict[str, Any], size: float) -> dict[str, Any]:
    """Return a segment of the route with its lengths scaled, its angles kept."""
    out: dict[str, Any] = {}
    for key, value in part.items():
        if isinstance(value, dict):
            out[key] = _scaled(value, size)
        elif isinstance(value, float) and key != "angle_deg":
            out[key] = value * size
        else:
            out[key] = value
    return {key: value for key, value in out.items() if value is not None}
