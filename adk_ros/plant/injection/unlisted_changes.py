# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sizes and constants of the injected changes that the catalogue of `adk mismatch` does not have.

`unlisted_torque` holds those of driveline and brakes, `unlisted_motion` those of steering, tyres,
wind and load, `sensor_dropouts` those of the sensors. The constants are choices that make a change
act during a part of every generated drive.
"""

from __future__ import annotations

from typing import NamedTuple

TORQUE_CUT_FROM = 2.5
"""Lateral acceleration above which drive torque is cut, m/s²."""
SLOSH_FREQUENCY_HZ, SLOSH_DAMPING = 0.5, 0.06
"""Natural frequency and damping ratio of a load that moves sideways."""
PERIODIC_YAW_HZ, PERIODIC_YAW_FROM = 0.28, 9.0
"""Frequency of the periodic yaw acceleration, and the speed above which it acts, m/s."""
FADE_ENERGY, FADE_COOLING_S = 300.0, 60.0
"""Brake work per mass, J/kg, that heats the brakes by one unit, and the time they cool in, s."""
FRICTION_TORQUE_TRAVEL = 60.0
"""Change of torque over which friction in the driveline reverses, N·m."""
RIPPLE_HZ = 2.5
"""Frequency of the torque ripple."""
RELEASE_FROM, RELEASE_HZ = 1.5, 4.0
"""Commanded deceleration above which the brakes are released in turns, m/s², and how often."""
LIMITED_FROM, LIMITED_OVER = 18.0, 2.0
"""Speed from which the drive torque is reduced, and the range over which it is, m/s."""
LOW_GEAR_BELOW = 20.0
"""Speed below which the low gear is engaged, m/s."""
SAG_S = 100.0
"""Time constant of the battery's sag, s."""
GUST_S, TOUCH_S = 0.8, 0.6
"""Duration of a gust and of a phantom braking, s."""
GUST_YAW = 0.12
"""Yaw acceleration per lateral acceleration of a gust, rad/m."""
EPISODE_EVERY_S, EPISODE_WITHIN_S = 12.0, 8.0
"""One episode in every interval of this length, and the part of it in which it begins, s."""
LAP_WAVES = 5
"""Oscillations of the yaw acceleration in a lap."""
WARMING_S, FADING_S = 50.0, 80.0
"""Time constants of the rolling resistance of cold tyres and of a fading front tyre, s."""
YAW_LIMIT = 0.2
"""Yaw rate above which the stability control brakes the yaw motion, rad/s."""
SWAY_HZ, SWAY_DAMPING, HITCH = 0.7, 0.15, 2.5
"""Natural frequency and damping ratio of a trailer, and how far the hitch is behind the centre of
gravity, m."""
RATIO_SPEED = 30.0
"""Speed at which the relative change of a variable steering ratio is that of its size, m/s."""


class UnlistedChanges(NamedTuple):
    """Sizes of unlisted changes; 0 for none. Fields are the names in labels."""

    locked_differential: float = 0.0
    """Opposing yaw acceleration per relative wheel-speed difference r / v_x, m/s²."""
    torque_steer: float = 0.0
    """Lateral acceleration per commanded torque, 1/(kg·m)."""
    shimmy: float = 0.0
    """Amplitude of a yaw acceleration that oscillates with the speed, sin(1.5 v_x), rad/s²."""
    yaw_damping: float = 0.0
    """Opposing yaw acceleration per yaw rate, 1/s."""
    scrub_drag: float = 0.0
    """Deceleration per lateral acceleration squared, s²/m."""
    torque_vectoring: float = 0.0
    """Yaw acceleration per torque times steering angle, 1/(kg·m²·rad)."""
    steering_drag: float = 0.0
    """Deceleration per magnitude of the steering angle, m/s² per rad."""
    torque_cut: float = 0.0
    """Share of the drive torque that is cut above `TORQUE_CUT_FROM` of lateral acceleration."""
    sloshing_load: float = 0.0
    """Share of the car's mass that moves sideways at `SLOSH_FREQUENCY_HZ`."""
    time_periodic_yaw: float = 0.0
    """Amplitude of a yaw acceleration that oscillates in time above a speed, rad/s²."""
    brake_fade: float = 0.0
    """Share of the brake torque that hot brakes lose."""
    torque_hysteresis: float = 0.0
    """Friction of the driveline, N·m: opposes changes of the torque (Dahl's model)."""
    brake_judder: float = 0.0
    """Relative amplitude of the brake torque over one turn of the wheels."""
    torque_ripple: float = 0.0
    """Relative amplitude of the torque at `RIPPLE_HZ`."""
    abs_release: float = 0.0
    """Share of the brake torque that is released in turns while braking hard."""
    speed_limiter: float = 0.0
    """Share of the drive torque that is cut above a speed."""
    low_gear_gain: float = 0.0
    """Relative gain of the drive torque below `LOW_GEAR_BELOW`."""
    battery_sag: float = 0.0
    """Share of the drive torque that a discharging battery loses in time."""
    torque_locking_differential: float = 0.0
    """Opposing yaw acceleration per r / v_x and magnitude of the torque, 1/(kg·m)."""
    wheel_imbalance: float = 0.0
    """Amplitude of a longitudinal acceleration once per turn of the wheels, at 20 m/s, m/s²."""
    gust_series: float = 0.0
    """Lateral acceleration by a gust, m/s²."""
    phantom_braking: float = 0.0
    """Deceleration of a short braking without a command, m/s²."""
    lap_periodic_yaw: float = 0.0
    """Amplitude of a yaw acceleration that oscillates with the distance in the lap, rad/s²."""
    warming_tyres: float = 0.0
    """Rolling resistance of cold tyres that falls in time."""
    fading_front_tyre: float = 0.0
    """Share of the front slip stiffness that is lost in time."""
    yaw_limiter: float = 0.0
    """Opposing yaw acceleration per yaw rate above `YAW_LIMIT`, 1/s."""
    trailer_sway: float = 0.0
    """Mass of a swaying trailer over that of the car."""
    variable_steering_ratio: float = 0.0
    """Relative decrease of the steering angle with the speed, at `RATIO_SPEED`."""
    brake_pull: float = 0.0
    """Yaw acceleration per brake torque, 1/(kg·m²)."""
    engine_braking: float = 0.0
    """Deceleration while the torque command is negative, m/s²."""


class Motion(NamedTuple):
    """Motion of the car at a step: what the changes depend on. SI units."""

    time_s: float
    distance: float
    """Arc length from the start of the route, m; it grows over the laps."""
    lap: float
    """Length of the lap, m."""
    v_x: float
    v_y: float
    yaw_rate: float
    heading: float
    a_y: float


BACKLASH, DELTA, TORQUE = 0, 1, 2
LOAD_Y, LOAD_SPEED, SWAY_Y, SWAY_SPEED = 3, 4, 5, 6
HEAT, FRICTION, LAST_TORQUE, WHEEL_ANGLE = 7, 8, 9, 10
MEMORY_SIZE = 11
"""Indices into the memory of actuation and changes: backlash, filtered steering angle and torque;
deflection and speed of the sloshing load and of the trailer; heat of the brakes, friction state,
torque a step before, and angle of the wheels, rad."""
