# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a vehicle file says of suspension, wheels and body, beyond the planar car: optional."""

from __future__ import annotations

from pydantic import Field

from adk_ros.files.yaml_file import FileModel


class Chassis(FileModel):
    """
    The part of a vehicle that only the fourteen-degree-of-freedom plant knows.

    Whatever is left out (None) is derived from masses and lengths as a passenger car has it: see
    `body.resolve`. Rates are those at the wheel, per wheel, along the body's vertical.
    """

    unsprung_mass_front: float | None = Field(default=None, ge=0.5, le=5e3)
    """One front wheel with its hub and motor, kg; else 4 % of the mass."""
    unsprung_mass_rear: float | None = Field(default=None, ge=0.5, le=5e3)
    roll_inertia: float | None = Field(default=None, ge=1.0, le=1e6)
    """Of the sprung mass about its own centre of gravity, kg m^2."""
    pitch_inertia: float | None = Field(default=None, ge=1.0, le=1e6)
    """Of the sprung mass about its own centre of gravity, kg m^2; else 0.8 of the yaw inertia."""
    spring_front: float | None = Field(default=None, ge=100.0, le=5e6)
    """N/m; else what gives the sprung corner 1.3 Hz in front and 1.45 Hz behind."""
    spring_rear: float | None = Field(default=None, ge=100.0, le=5e6)
    damper_front: float | None = Field(default=None, ge=0.0, le=1e6)
    """N s/m, bump and rebound alike; else 0.35 of critical."""
    damper_rear: float | None = Field(default=None, ge=0.0, le=1e6)
    anti_roll_front: float | None = Field(default=None, ge=0.0, le=1e7)
    """N m per rad of roll against the axle; else 0.45 (front), 0.15 (rear) of what springs do."""
    anti_roll_rear: float | None = Field(default=None, ge=0.0, le=1e7)
    tyre_stiffness_front: float | None = Field(default=None, ge=1e3, le=1e8)
    """Vertical, N/m; else the static load over 20 mm."""
    tyre_stiffness_rear: float | None = Field(default=None, ge=1e3, le=1e8)
    tyre_damping_front: float | None = Field(default=None, ge=0.0, le=1e6)
    """Vertical, N s/m; else 0.02 of critical."""
    tyre_damping_rear: float | None = Field(default=None, ge=0.0, le=1e6)
    roll_centre_front: float = Field(default=0.05, ge=-1.0, le=2.0)
    """Height over the road of the axle's roll centre, m: what of the lateral force tips the body
    through links instead of springs, and jacks it up."""
    roll_centre_rear: float = Field(default=0.08, ge=-1.0, le=2.0)
    travel: float = Field(default=0.09, ge=0.005, le=1.0)
    """Wheel travel to either side before the stops, m."""
    stop_stiffness: float | None = Field(default=None, ge=0.0, le=5e6)
    """Of the stops, N/m; else five times the front spring."""
    lift_area_front: float = Field(default=0.1, ge=-20.0, le=20.0)
    """Lift at the axle over air pressure, m^2; negative is downforce."""
    lift_area_rear: float = Field(default=0.1, ge=-20.0, le=20.0)
    motor_limit_front: float | None = Field(default=None, ge=0.0, le=1e5)
    """Most that one front motor drives or brakes with, N m; else its share of the car's most."""
    motor_limit_rear: float | None = Field(default=None, ge=0.0, le=1e5)
    brake_split_front: float = Field(default=0.6, ge=0.0, le=1.0)
    """Front axle's share of what the friction brakes do."""
    brake_lag: float = Field(default=0.06, ge=0.0, le=5.0)
    """Time constant of the friction brakes, s; that of the motors is the car's `torque_lag`."""
