# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Driver model: follows a route with a speed plan and adds excitation to the commands.

Steering: feedforward from the previewed curvature with the understeer gradient, plus pure pursuit.
Torque: feedforward of the planned acceleration and the known resistances, plus a PI controller.
The excitation makes vehicle and driver separately identifiable (closed-loop identification).

Lengths, times and torques are those of a full-size car; a scale model drives the similar ones
(`numerics.similarity`).
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
"""Preview time for curvature and speed plan, s: compensates command hold (25 ms), actuator lags
and tyre relaxation."""

_GAIN_P, _GAIN_I = 0.8, 0.15
"""Speed controller: acceleration per speed error, 1/s, and per integral of it, 1/s². Closed-loop
time constant of 1.25 s and damping ratio of about 1; chosen for smooth following of the plan."""
_FULL_EXCITATION_SPEED = 20.0
"""Speed up to which the full excitation is added to the steering, m/s."""


class SpeedPlan(FileModel):
    """Limits of the planned speed."""

    top: float = Field(default=30.0, ge=3.0, le=80.0)
    """Largest planned speed, m/s, before the variation."""
    lateral_accel: float = Field(default=4.2, gt=0.2, le=12.0)
    """Largest lateral acceleration, m/s²."""
    accel: float = Field(default=1.8, gt=0.1, le=8.0)
    """Largest acceleration, m/s²."""
    brake: float = Field(default=2.8, gt=0.1, le=10.0)
    """Largest deceleration, m/s²."""
    variation: float = Field(default=0.06, ge=0.0, le=0.3)
    """Relative variation of the speed about the plan, with periods of 13 and 37 s."""


class Excitation(FileModel):
    """Signals added to the driver's commands: coloured noise, and steps of torque."""

    steer: float = Field(default=0.004, ge=0.0, le=0.1)
    """Standard deviation up to 20 m/s, rad; above, it falls with the square of the speed."""
    steer_bandwidth_hz: float = Field(default=0.8, gt=0.01, le=10.0)
    torque: float = Field(default=150.0, ge=0.0, le=3000.0)
    """Standard deviation of the noise, N·m."""
    torque_bandwidth_hz: float = Field(default=0.7, gt=0.01, le=10.0)
    torque_step: float = Field(default=200.0, ge=0.0, le=3000.0)
    """Size of the steps up and down, N·m, at random times, 1.5 s apart on average."""


def plan_speed(route: Route, plan: SpeedPlan) -> Route:
    """
    Return the route with ROAD_SPEED filled in, m/s.

    The lateral acceleration limits the speed in bends; acceleration and braking are limited by a
    friction ellipse. One backward sweep (braking) and one forward sweep (accelerating), each over
    two laps of the closed route, converge.
    """
    table = route.table.copy()
    curvature = np.abs(table[:, ROAD_CURVATURE])
    limit = np.sqrt(plan.lateral_accel / np.maximum(curvature, 1e-9))
    speed = np.minimum(np.minimum(limit, plan.top), table[:, ROAD_SPEED])[:-1]
    rows = speed.shape[0]
    for accel_limit, direction in ((plan.brake, -1), (plan.accel, 1)):
        order = np.arange(2 * rows)[::direction] % rows
        before = order[0]
        for i in order[1:]:
            lateral = min(speed[before] ** 2 * curvature[before] / plan.lateral_accel, 1.0)
            accel = accel_limit * math.sqrt(max(1.0 - lateral**2, 0.05))
            speed[i] = min(speed[i], math.sqrt(speed[before] ** 2 + 2.0 * accel * route.spacing))
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
    Return (n, 5), one row per command.

    Columns: added torque, N·m; added steering angle, rad; factor on the speed plan; limit of the
    target speed, m/s; its rate, m/s². The limit rises from `start_speed` with the acceleration of
    the plan; without `start_speed` it is infinite.
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
    variation = 0.6 * np.sin(2.0 * math.pi * t / 37.0 + phases[0])
    variation += 0.4 * np.sin(2.0 * math.pi * t / 13.0 + phases[1])
    out[:, 2] = 1.0 + plan.variation * variation
    out[:, 3] = np.inf if start_speed is None else start_speed + plan.accel * t
    out[:, 4] = plan.accel
    return out


@strict_kernel
def understeer_gradient(c: Constants) -> float:
    """Return K of delta = (L + K v²) kappa, rad·s²/m, from the slip stiffness of the axles."""
    wheelbase = c.cg_to_front_axle + c.cg_to_rear_axle
    compliance = 0.0
    for front in (True, False):
        tyre = axle_tyre(c, front)
        other = c.cg_to_rear_axle if front else c.cg_to_front_axle
        load = 0.5 * c.mass * GRAVITY * other / wheelbase
        stiffness = tyre.b_y * tyre.c_y * friction(tyre, load)
        compliance += (1.0 if front else -1.0) / stiffness
    return compliance / GRAVITY


@strict_kernel
def driver_command(
    c: Constants,
    table: FloatArray,
    spacing: float,
    position: tuple[float, float, float],
    velocity: tuple[float, float],
    heading: float,
    added: FloatArray,
    integral: float,
    period_s: float,
) -> tuple[float, float, float]:
    """
    Return the next command (torque in N·m, delta in rad) and the new speed integral, m/s².

    `position`: result of `locate`; `velocity`: (v_x, v_y), m/s; `added`: a row of
    `excitation_signals`; `integral`: the integral term before.
    """
    s, across, road_heading = position
    v_x, v_y = velocity
    tempo = math.sqrt(c.length_scale)
    speed = max(v_x, 3.0 * tempo)
    course_error = heading + math.atan2(v_y, speed) - road_heading
    course_error = math.atan2(math.sin(course_error), math.cos(course_error))
    ahead = s + speed * (_PREVIEW_TIME_S * tempo)
    curvature = lookup(table, spacing, ahead, ROAD_CURVATURE)
    wheelbase = c.cg_to_front_axle + c.cg_to_rear_axle
    delta = (wheelbase + understeer_gradient(c) * speed * speed) * curvature
    # Pure pursuit: lookahead distance of 0.8 s of driving, at least 6 m.
    lookahead = max(6.0 * c.length_scale, 0.8 * tempo * speed)
    delta -= (
        2.0 * wheelbase * (across + lookahead * math.sin(course_error)) / (lookahead * lookahead)
    )
    # The lateral acceleration per steering angle grows with the speed squared.
    delta += added[1] * min(1.0, (_FULL_EXCITATION_SPEED * tempo / speed) ** 2)

    plan = lookup(table, spacing, ahead, ROAD_SPEED)
    after = lookup(table, spacing, ahead + spacing, ROAD_SPEED)
    target = added[2] * plan
    accel = added[2] * added[2] * plan * (after - plan) / spacing
    if added[3] < target:
        target = added[3]
        accel = added[4]
    error = target - v_x
    air = 0.5 * AIR_DENSITY * c.cda * v_x * abs(v_x)
    force = c.mass * (accel + _GAIN_P / tempo * error + integral) + air + c.crr * c.mass * GRAVITY
    force += c.mass * GRAVITY * math.sin(lookup(table, spacing, s, ROAD_GRADE))
    torque = force * c.wheel_radius + added[0]
    if -c.max_brake_torque < torque < c.max_drive_torque:
        integral = min(max(integral + _GAIN_I / c.length_scale * error * period_s, -2.0), 2.0)
    torque = min(max(torque, -c.max_brake_torque), c.max_drive_torque)
    return torque, min(max(delta, -c.max_steer), c.max_steer), integral
