# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Optional chassis section of a vehicle file: suspension, unsprung masses and brakes."""

from __future__ import annotations

from pydantic import Field

from adk_ros.files.yaml_file import FileModel


class Chassis(FileModel):
    """
    Parameters that only the fourteen-degree-of-freedom plant uses.

    `resolve` in `sprung_mass` derives missing values (None) from masses and lengths, typical of a
    passenger car. Stiffness and damping are wheel rates, per wheel, along the body's vertical.
    """

    unsprung_mass_front: float | None = Field(default=None, gt=0.0, le=5e3)
    """Mass of one front wheel with hub and motor, kg; default: 4 % of the vehicle mass."""
    unsprung_mass_rear: float | None = Field(default=None, gt=0.0, le=5e3)
    roll_inertia: float | None = Field(default=None, gt=0.0, le=1e6)
    """Of the sprung mass about its own centre of gravity, kg·m²; default: radius of gyration 0.36
    of the track width."""
    pitch_inertia: float | None = Field(default=None, gt=0.0, le=1e6)
    """Of the sprung mass about its own centre of gravity, kg·m²; default: 0.8 of the yaw
    inertia."""
    spring_front: float | None = Field(default=None, gt=0.0, le=5e6)
    """N/m; default: heave frequency of 1.3 Hz at the front, 1.45 Hz at the rear."""
    spring_rear: float | None = Field(default=None, gt=0.0, le=5e6)
    damper_front: float | None = Field(default=None, ge=0.0, le=1e6)
    """N·s/m, equal in bump and rebound; default: 0.35 of critical."""
    damper_rear: float | None = Field(default=None, ge=0.0, le=1e6)
    anti_roll_front: float | None = Field(default=None, ge=0.0, le=1e7)
    """Roll stiffness of the anti-roll bar, N·m/rad; default: 0.45 (front), 0.15 (rear) of the roll
    stiffness of the axle's springs."""
    anti_roll_rear: float | None = Field(default=None, ge=0.0, le=1e7)
    tyre_stiffness_front: float | None = Field(default=None, gt=0.0, le=1e8)
    """Vertical, N/m; default: static deflection of 20 mm."""
    tyre_stiffness_rear: float | None = Field(default=None, gt=0.0, le=1e8)
    tyre_damping_front: float | None = Field(default=None, ge=0.0, le=1e6)
    """Vertical, N·s/m; default: 0.02 of critical."""
    tyre_damping_rear: float | None = Field(default=None, ge=0.0, le=1e6)
    roll_centre_front: float = Field(default=0.05, ge=-1.0, le=2.0)
    """Height of the axle's roll centre over the road, m. The lateral force times this height rolls
    and jacks the body through the links instead of the springs."""
    roll_centre_rear: float = Field(default=0.08, ge=-1.0, le=2.0)
    travel: float = Field(default=0.09, gt=0.0, le=1.0)
    """Wheel travel to the bump and rebound stops, m."""
    stop_stiffness: float | None = Field(default=None, ge=0.0, le=5e6)
    """Of the stops, N/m; default: five times the front spring."""
    lift_area_front: float = Field(default=0.1, ge=-20.0, le=20.0)
    """Lift at the axle over dynamic pressure, m²; negative is downforce."""
    lift_area_rear: float = Field(default=0.1, ge=-20.0, le=20.0)
    motor_limit_front: float | None = Field(default=None, ge=0.0, le=1e5)
    """Largest drive or brake torque of one front motor, N·m; default: its share of
    `max_drive_torque`."""
    motor_limit_rear: float | None = Field(default=None, ge=0.0, le=1e5)
    brake_split_front: float = Field(default=0.6, ge=0.0, le=1.0)
    """Front axle's share of the friction brake torque."""
    brake_lag: float = Field(default=0.06, ge=0.0, le=5.0)
    """Time constant of the friction brakes, s; that of the motors is `torque_lag`."""
