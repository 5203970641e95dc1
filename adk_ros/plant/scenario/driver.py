# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A driver who follows a route by a speed plan, and who shakes the car on purpose.

Steering is the road's curvature some way ahead with the car's own understeer, plus pure pursuit of
a point ahead; torque is the plan's acceleration and the known resistances, plus a PI controller.
On top comes excitation, without which one could not tell the car from its driver.
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from adk_ros.files.yaml_file import FileModel
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.environment.coloured_noise import coloured_noise
from adk_ros.plant.environment.road import ROAD_CURVATURE, ROAD_GRADE, ROAD_SPEED, Route, lookup
from adk_ros.plant.vehicle.tyre import axle_tyre, friction
from adk_ros.plant.vehicle.vehicle_parameters import Constants

_PREVIEW_TIME_S = 0.12
"""Seconds ahead at which the driver reads curvature and plan: what the actuators will take."""

_GAIN_P, _GAIN_I = 0.8, 0.15
_FULL_EXCITATION_SPEED = 20.0
"""m/s up to which the driver adds the full excitation to the steering."""


class SpeedPlan(FileModel):
    """How fast to drive."""

    top: float = Field(default=30.0, ge=3.0, le=80.0)
    """Never faster, m/s, but for the variation."""
    lateral_accel: float = Field(default=4.2, gt=0.2, le=12.0)
    """Planned in bends, m/s^2."""
    accel: float = Field(default=1.8, gt=0.1, le=8.0)
    brake: float = Field(default=2.8, gt=0.1, le=10.0)
    variation: float = Field(default=0.06, ge=0.0, le=0.3)
    """Share by which the speed wanders about the plan, over some ten to forty seconds."""


class Excitation(FileModel):
    """What is added to the driver's commands: coloured noise, and steps of torque."""

    steer: float = Field(default=0.004, ge=0.0, le=0.1)
    """Standard deviation up to 20 m/s, rad; above, it shrinks with the speed squared."""
    steer_bandwidth_hz: float = Field(default=0.8, gt=0.01, le=10.0)
    torque: float = Field(default=150.0, ge=0.0, le=3000.0)
    """Standard deviation of the noise, N m."""
    torque_bandwidth_hz: float = Field(default=0.7, gt=0.01, le=10.0)
    torque_step: float = Field(default=200.0, ge=0.0, le=3000.0)
    """Size of the steps up and down, N m, at random times some 1.5 s apart."""


def plan_speed(route: Route, plan: SpeedPlan) -> Route:
    """
    Return the route with ROAD_SPEED filled in, m/s.

    Bends limit by lateral acceleration; acceleration and braking shrink with the lateral share on
    an ellipse; two sweeps round the closed lap in each direction settle it.
    """
    table = route.table.copy()
    bend = np.abs(table[:, ROAD_CURVATURE])
    limit = np.sqrt(plan.lateral_accel / np.maximum(bend, 1e-9))
    speed = np.minimum(np.minimum(limit, plan.top), table[:, ROAD_SPEED])[:-1]
    rows = speed.shape[0]
    for sweep, along in ((plan.brake, -1), (plan.accel, 1)):
        order = np.arange(2 * rows)[::along] % rows
        before = order[0]
        for i in order[1:]:
            share = min(speed[before] ** 2 * bend[before] / plan.lateral_accel, 1.0)
            most = sweep * math.sqrt(max(1.0 - share**2, 0.05))
            speed[i] = min(speed[i], math.sqrt(speed[before] ** 2 + 2.0 * most * route.spacing))
            before = i
    table[:-1, ROAD_SPEED] = speed
    table[-1, ROAD_SPEED] = speed[0]
    return Route(table, route.spacing)


def excitation_signals(
    rng: np.random.Generator,
    n: int,
    period_s: float,
    excitation: Excitation,
    plan: SpeedPlan,
    start_speed: float | None = None,
) -> FloatArray:
    """
    Return (n, 5), a row a command: torque to add, angle to add, factor on the speed plan, limit.

    The limit on the wished speed, m/s, rises from `start_speed` at the last column's rate, the
    plan's acceleration; there is none for a drive that starts at the plan's own speed.
    """
    out = np.empty((n, 5))
    t = period_s * np.arange(n)
    switches = np.cumsum(rng.random(n) < period_s / 1.5)
    levels = rng.choice([-1.0, 0.0, 1.0], size=n + 1)
    out[:, 0] = excitation.torque_step * levels[switches]
    out[:, 0] += excitation.torque * coloured_noise(
        rng, n, period_s, excitation.torque_bandwidth_hz
    )
    out[:, 1] = excitation.steer * coloured_noise(rng, n, period_s, excitation.steer_bandwidth_hz)
    phases = rng.uniform(0.0, 2.0 * math.pi, 2)
    wander = 0.6 * np.sin(2.0 * math.pi * t / 37.0 + phases[0])
    wander += 0.4 * np.sin(2.0 * math.pi * t / 13.0 + phases[1])
    out[:, 2] = 1.0 + plan.variation * wander
    out[:, 3] = np.inf if start_speed is None else start_speed + plan.accel * t
    out[:, 4] = plan.accel
    return out


@strict_kernel
def understeer_gradient(c: Constants) -> float:
    """Return K in delta = L kappa + K v^2 kappa, rad s^2/m, from the slip stiffnesses."""
    wheelbase = c.cg_to_front_axle + c.cg_to_rear_axle
    softness = 0.0
    for front in (True, False):
        tyre = axle_tyre(c, front)
        other = c.cg_to_rear_axle if front else c.cg_to_front_axle
        load = 0.5 * c.mass * GRAVITY * other / wheelbase
        stiffness = tyre.b_y * tyre.c_y * friction(tyre, load)
        softness += (1.0 if front else -1.0) / stiffness
    return softness / GRAVITY


@strict_kernel
def driver_command(
    c: Constants,
    table: FloatArray,
    spacing: float,
    place: tuple[float, float, float],
    velocity: tuple[float, float],
    heading: float,
    added: FloatArray,
    integral: float,
    period_s: float,
) -> tuple[float, float, float]:
    """
    Return the next command (torque N m, delta rad) and the new speed integral.

    `place` is what `locate` returned, `velocity` (v_x, v_y), `added` a row of
    `excitation_signals`.
    """
    s, across, road_heading = place
    v_x, v_y = velocity
    speed = max(v_x, 3.0)
    course = heading + math.atan2(v_y, speed) - road_heading
    course = math.atan2(math.sin(course), math.cos(course))
    ahead = s + speed * _PREVIEW_TIME_S
    curvature = lookup(table, spacing, ahead, ROAD_CURVATURE)
    wheelbase = c.cg_to_front_axle + c.cg_to_rear_axle
    delta = (wheelbase + understeer_gradient(c) * speed * speed) * curvature
    reach = max(6.0, 0.8 * speed)
    delta -= 2.0 * wheelbase * (across + reach * math.sin(course)) / (reach * reach)
    # The same angle throws a fast car further off its line: shake it in proportion.
    delta += added[1] * min(1.0, (_FULL_EXCITATION_SPEED / speed) ** 2)

    plan = lookup(table, spacing, ahead, ROAD_SPEED)
    after = lookup(table, spacing, ahead + spacing, ROAD_SPEED)
    wanted = added[2] * plan
    accel = added[2] * added[2] * plan * (after - plan) / spacing
    if added[3] < wanted:
        wanted = added[3]
        accel = added[4]
    error = wanted - v_x
    air = 0.5 * AIR_DENSITY * c.cda * v_x * abs(v_x)
    force = c.mass * (accel + _GAIN_P * error + integral) + air + c.crr * c.mass * GRAVITY
    force += c.mass * GRAVITY * math.sin(lookup(table, spacing, s, ROAD_GRADE))
    torque = force * c.wheel_radius + added[0]
    if -c.max_brake_torque < torque < c.max_drive_torque:
        integral = min(max(integral + _GAIN_I * error * period_s, -2.0), 2.0)
    torque = min(max(torque, -c.max_brake_torque), c.max_drive_torque)
    return torque, min(max(delta, -c.max_steer), c.max_steer), integral
