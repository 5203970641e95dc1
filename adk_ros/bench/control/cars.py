# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cars and roads of the closed loop: the nominal one, and one change of it at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from adk_ros.files.yaml_file import with_replacements
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.environment.surface import even_planes
from adk_ros.plant.scenario.sensor_simulation import TICK
from adk_ros.plant.vehicle.fourteen_dof import (
    HEADING,
    STATE_SIZE,
    V_X,
    YAW_RATE,
    X,
    advance,
    rolling_state,
)
from adk_ros.plant.vehicle.seven_dof import STEP
from adk_ros.plant.vehicle.sprung_mass import resolve
from adk_ros.plant.vehicle.tyre import axle_tyre, friction
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle

NOMINAL = "nominal"
NOMINAL_MU = 0.85
"""Friction of the nominal road: that of the packaged scenario `handling`."""


@dataclass(frozen=True)
class Car:
    """A vehicle and the friction of the road that it drives on."""

    name: str
    vehicle: Vehicle
    mu: float = NOMINAL_MU

    def grip(self) -> float:
        """
        Return the largest lateral acceleration of the weaker axle at static loads, m/s².

        a = g mu min(mu_f(F_zf), mu_r(F_zr)); load transfer lowers the true one.
        """
        c = self.vehicle.constants()
        wheelbase = c.cg_to_front_axle + c.cg_to_rear_axle
        of_axles = [
            friction(axle_tyre(c, front), 0.5 * c.mass * GRAVITY * other / wheelbase)
            for front, other in ((True, c.cg_to_rear_axle), (False, c.cg_to_front_axle))
        ]
        return float(GRAVITY * self.mu * min(of_axles))


def _changes() -> dict[str, tuple[dict[str, Any], float]]:
    """Return changes of the vehicle and friction of the road, by name of the car."""
    worn = {"mu": 0.88, "b_x": 11.0, "b_y": 10.8, "relaxation_length": 0.3}
    return {
        NOMINAL: ({}, NOMINAL_MU),
        # As in the packaged scenario mass_plus_160.
        "+160 kg": ({"mass": 2230.0}, NOMINAL_MU),
        "low friction": ({}, 0.7),
        # The rear tyres of the packaged scenario worn_tyres; the front ones are nominal.
        "worn rear tyres": ({"rear_tyre": worn}, NOMINAL_MU),
        # Nominal: 30 ms.
        "100 ms steering lag": ({"steer_lag": 0.1}, NOMINAL_MU),
    }


CARS = tuple(_changes())


def make_car(name: str) -> Car:
    """Return the car of one of `CARS`."""
    changes, mu = _changes()[name]
    content = with_replacements(load_vehicle("imdv").model_dump(), changes)
    return Car(name, Vehicle.model_validate(content), mu)


class SimulatedCar:
    """
    The plant with fourteen degrees of freedom on an even road, one command of 25 ms at a time.

    `state` (STATE_SIZE,): that of `fourteen_dof`; `acceleration` (2,): specific force at it, m/s².
    """

    def __init__(self, car: Car, speed: float, pose: FloatArray) -> None:
        self.constants = car.vehicle.constants()
        self.body = resolve(car.vehicle)
        self.planes = even_planes(car.mu)
        self.state = rolling_state(self.constants, speed, self.planes[0], *pose.tolist())
        self.acceleration = np.zeros(2)

    @property
    def velocity(self) -> FloatArray:
        """Return the true (v_x, v_y, yaw rate), m/s and rad/s."""
        return np.array(self.state[V_X : YAW_RATE + 1])

    @property
    def pose(self) -> FloatArray:
        """Return the true (x, y, heading), m and rad."""
        return np.array(self.state[X : HEADING + 1])

    def step(self, command: FloatArray) -> None:
        """Advance by 25 ms under `command` (torque in N·m, road-wheel angle in rad)."""
        states, forces = np.empty((2, STATE_SIZE)), np.empty((2, 2))
        advance(
            self.constants, self.body, self.state, command[None], self.planes, (0.0, 0.0), STEP,
            TICK, states, forces,
        )  # fmt: skip
        self.acceleration = forces[1].copy()
