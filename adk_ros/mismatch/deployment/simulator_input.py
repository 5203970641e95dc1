# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A simulator that is given as a file and not as its recording: a vehicle's YAML, or a stand-in's.

A vehicle (the seven degrees of freedom of `adk simulate`) is driven, without noise, over a course
as fast and as hard as the recording was, and looked at as a recording is. A stand-in (an earlier
report's `simulation.yaml`) needs no looking at.
"""

from __future__ import annotations

from dataclasses import dataclass
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
"""kg, of the car that the course's excitation is meant for."""
_ENVELOPE_MARGINS = (1.25, 1.1, 0.95, 0.8)
"""
How much harder than the recording is driven, less where the car spins: what a simulator does not
show is not known, and what it shows of a spin is of no use.
"""
_MAX_SIDESLIP = 0.35
"""A sideslip, rad, that no car on its course has."""
_WINDOW = 25


@dataclass(frozen=True)
class DrivingEnvelope:
    """How a recording was driven: its top speed, m/s, and its accelerations, m/s^2."""

    top: float
    lateral: float
    forward: float
    braking: float


def is_simulator_file(path: Path) -> bool:
    """Whether a simulation is given as a YAML file."""
    return path.suffix in {".yaml", ".yml"}


def driving_envelope(recording: SensorLog) -> DrivingEnvelope:
    """Return how a recording was driven: what it exceeds for one second in a hundred."""
    e = recording
    v_x, rate = (savitzky_golay(e.odometry[:, i], _WINDOW) for i in (0, 2))
    along = np.gradient(v_x, e.odometry_s)
    return DrivingEnvelope(
        top=float(np.clip(np.percentile(v_x, 99.0), 5.0, 90.0)),
        lateral=float(np.clip(np.percentile(np.abs(v_x * rate), 99.0), 1.0, 20.0)),
        forward=float(np.clip(np.percentile(along, 99.0), 0.5, 10.0)),
        braking=float(np.clip(-np.percentile(along, 1.0), 0.5, 12.0)),
    )


def load_simulator(path: Path) -> Vehicle | SurrogateModel:
    """
    Load a simulator's file.

    Raises `UsageError`, one line naming the file and the key; for a stand-in that has terms
    added, since those need not be a simulator's.
    """
    if not path.is_file():
        raise UsageError(f"{path} is not there: give a bag, a vehicle's YAML or a stand-in's")
    if not is_surrogate_file(path):
        return load_vehicle(path)
    content = load_surrogate(path).content
    if content.terms or content.correction:
        raise UsageError(
            f"{path}: it has terms that were found in a recording: give the simulation.yaml that "
            "lies beside it"
        )
    return content.simulator()


def simulate_matched_drive(
    vehicle: Vehicle, recording: SensorLog, name: str = "simulation"
) -> SensorLog:
    """
    Return what perfect sensors say of a vehicle that is driven like a recording.

    The course is the packaged handling course, as large as it takes to reach the recording's
    speed at its lateral acceleration. Raises `UsageError` for a vehicle that cannot drive it.
    """
    how = driving_envelope(recording)
    for margin in _ENVELOPE_MARGINS:
        driven = _simulate(vehicle, how, margin, name)
        v_x, v_y = driven.odometry[:, 0], driven.odometry[:, 1]
        if np.all(np.abs(v_y) < np.tan(_MAX_SIDESLIP) * np.maximum(v_x, 3.0)):
            break
    return driven


def _simulate(vehicle: Vehicle, how: DrivingEnvelope, margin: float, name: str) -> SensorLog:
    base = load_scenario(_SCENARIO)
    # Held within what a speed plan may ask for.
    lateral, top = min(margin * how.lateral, 12.0), min(1.05 * how.top, 80.0)
    size = (top / base.speed.top) ** 2 * base.speed.lateral_accel / lateral
    # Its tightest bend has a radius of 16 m, and none may have less than 6 m.
    size = float(np.clip(size, 0.4, 50.0))
    heavy = vehicle.mass / _REFERENCE_MASS
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
            accel=float(np.clip(margin * how.forward, 1.0, 8.0)),
            brake=float(np.clip(margin * how.braking, 1.0, 10.0)),
        ),
        excitation=Excitation(steer=0.003, torque=150.0 * heavy, torque_step=200.0 * heavy),
        sensors=Sensors(
            imu=Imu(rate_hz=100.0, phase_s=0.005),
            odometry=Odometry(rate_hz=50.0, phase_s=0.005),
            command=Command(rate_hz=40.0),
        ).clean(),
        vehicle_changes=vehicle.model_dump(exclude={"name"}),
    )
    return sensor_log_of(simulate(validate(name, scenario.model_dump(), Scenario)))


def sensor_log_of(drive: SimulatedDrive) -> SensorLog:
    """Return what a simulated drive's sensors say, as a bag of it would be read."""
    at, values = {}, {}
    for source, stream in drive.streams.items():
        at[source], values[source] = _seconds(stream.stamp_ns), stream.values
    odometry = values[Source.ODOMETRY]
    pose = odometry[:, 3:6].copy()
    pose[:, 2] = np.unwrap(pose[:, 2])
    return SensorLog(
        drive.name,
        float(_seconds(drive.stamp_ns)[-1]),
        at[Source.IMU],
        values[Source.IMU],
        at[Source.ODOMETRY],
        np.ascontiguousarray(odometry[:, :3]),
        pose,
        at[Source.COMMAND],
        values[Source.COMMAND],
    )


def _seconds(stamp_ns: IntArray) -> FloatArray:
    return np.asarray((stamp_ns - START_NS) * 1e-9, dtype=np.float64)


def _scaled(part: dict[str, Any], size: float) -> dict[str, Any]:
    """Return a segment of the course that many times as large, its angles kept."""
    out: dict[str, Any] = {}
    for key, value in part.items():
        if isinstance(value, dict):
            out[key] = _scaled(value, size)
        elif isinstance(value, float) and key != "angle_deg":
            out[key] = value * size
        else:
            out[key] = value
    return {key: value for key, value in out.items() if value is not None}
