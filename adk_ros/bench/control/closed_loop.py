# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One closed loop: car, sensors, prediction model and controller, a cycle of 25 ms at a time.

A command decided in a cycle acts from the next one on. Each cycle has one reading of each sensor,
with the noise of the package's default sensors, without delay. A driver drives the approach; its
commands, and all noise, depend on the seed alone.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from adk_ros.bench.control.cars import SimulatedCar
from adk_ros.bench.control.controllers import Controller
from adk_ros.bench.control.prediction_models import PredictionModel
from adk_ros.bench.control.reference_path import ReferencePath
from adk_ros.bench.control.tracking_cost import TICK_S, TrackingStart
from adk_ros.errors import UsageError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import locate
from adk_ros.plant.scenario.driver import (
    Excitation,
    SpeedPlan,
    driver_command,
    excitation_signals,
)
from adk_ros.plant.scenario.sensor_simulation import START_NS
from adk_ros.plant.scenario.sensors import Imu, Odometry
from adk_ros.plant.vehicle.vehicle_parameters import Constants
from adk_ros.signals.channels import TICK_NS, Flag, Sample

LOST_M = 5.0
"""Lateral error, m, from which a run has left the road: it ends there."""
_LONGEST = 2.0
"""Duration over the planned one after which a run ends: the car has stopped."""

_PACE, _STEER = 0.85, 0.002
"""The driver's speed over the planned one, and excitation of its steering, rad: it does not know
the car and loses one with worn rear tyres at the planned speed."""
_RISE_M = (60.0, 10.0)
"""Distances before the handover between which the driver speeds up to the planned speed, m."""


@dataclass(frozen=True)
class ClosedLoopRun:
    """
    The scored part of a run, one row per cycle, SI.

    `s` (n,): arc length; `lateral`, `speed_error` (n,): true errors against the path; `pose` (n,
    3); `commands` (n, 2); `cycle_s` (n,): time of update and decision. Not `completed`: the car
    left the road, took twice the planned time or had no prediction, and the rows end there.
    """

    s: FloatArray
    lateral: FloatArray
    speed_error: FloatArray
    pose: FloatArray
    commands: FloatArray
    cycle_s: FloatArray
    completed: bool


class Sensors:
    """Readings of the car's sensors: velocities, specific force and pose with noise."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 1])
        odometry, imu = Odometry(), Imu()
        self._velocity = np.array([odometry.velocity_noise] * 2 + [odometry.yaw_rate_noise])
        self._pose = np.array([odometry.position_noise] * 2 + [odometry.heading_noise])
        self._accel = imu.accel_noise

    def read(
        self, car: SimulatedCar, cycle: int, in_force: FloatArray
    ) -> tuple[Sample, FloatArray]:
        """Return the sample of a cycle and the measured pose (3,)."""
        noise = self._rng.standard_normal(8)
        x = car.velocity + self._velocity * noise[:3]
        a = car.acceleration + self._accel * noise[3:5]
        sample = Sample(
            START_NS + cycle * TICK_NS,
            (float(x[0]), float(x[1]), float(x[2])),
            (float(in_force[0]), float(in_force[1])),
            (float(a[0]), float(a[1])),
            int(Flag.RESTART if cycle == 0 else Flag.OK),
        )
        return sample, car.pose + self._pose * noise[5:]


class ApproachDriver:
    """The package's driver with the parameters of the nominal car, and excitation."""

    def __init__(self, nominal: Constants, path: ReferencePath, seed: int) -> None:
        self._nominal, self._route = nominal, path.route
        rng = np.random.default_rng([seed, 2])
        cycles = round(_LONGEST * path.planned_s(path.start, path.handover) / TICK_S) + 1
        self._added = excitation_signals(
            rng, cycles, TICK_S, Excitation(steer=_STEER), SpeedPlan(variation=0.04)
        )
        self._handover = path.handover
        self._integral = 0.0

    def command(self, cycle: int, pose: FloatArray, sample: Sample, s: float) -> FloatArray:
        """Return the command (2,) for the next cycle."""
        table, spacing = self._route.table, self._route.spacing
        added = self._added[min(cycle, len(self._added) - 1)].copy()
        left = self._handover - s
        added[2] *= float(np.interp(-left, (-_RISE_M[0], -_RISE_M[1]), (_PACE, 1.0)))
        position = locate(table, spacing, s, pose[0], pose[1])
        torque, delta, self._integral = driver_command(
            self._nominal, table, spacing, position, (sample.x[0], sample.x[1]), float(pose[2]),
            added, self._integral, TICK_S,
        )  # fmt: skip
        return np.array([torque, delta])


def run_closed_loop(
    car: SimulatedCar,
    path: ReferencePath,
    model: PredictionModel,
    controller: Controller,
    driver: ApproachDriver,
    sensors: Sensors,
) -> ClosedLoopRun:
    """Drive `path` once with a car that is at its start, with the planned speed."""
    table, spacing = path.route.table, path.route.spacing
    s = path.start
    in_force = np.zeros(2)
    rows: list[FloatArray] = []
    cycles = round(_LONGEST * path.planned_s(path.start, path.end) / TICK_S)
    completed = False
    for cycle in range(cycles):
        true_pose = car.pose
        s, across, _ = locate(table, spacing, s, true_pose[0], true_pose[1])
        completed = s >= path.end
        if completed or abs(across) > LOST_M:
            break
        sample, pose = sensors.read(car, cycle, in_force)
        began_s = time.perf_counter()
        model.update(sample)
        if s < path.handover:
            command = driver.command(cycle, pose, sample, s)
        else:
            measured_s = locate(table, spacing, s, pose[0], pose[1])[0]
            start = TrackingStart(pose, np.array(sample.x), measured_s)
            try:
                command = controller.next_command(model, start, in_force)
            except UsageError:
                break  # The model predicts nothing from here, so nobody drives.
            cycle_s = time.perf_counter() - began_s
            if s >= path.begin:
                speed_error = car.velocity[0] - path.pose_at(s)[1]
                values = [s, across, speed_error, *true_pose, *in_force, cycle_s]
                rows.append(np.array(values))
        car.step(in_force)
        in_force = command
    table_of_rows = np.array(rows).reshape(-1, 9)
    return ClosedLoopRun(
        s=table_of_rows[:, 0],
        lateral=table_of_rows[:, 1],
        speed_error=table_of_rows[:, 2],
        pose=table_of_rows[:, 3:6],
        commands=table_of_rows[:, 6:8],
        cycle_s=table_of_rows[:, 8],
        completed=completed,
    )
