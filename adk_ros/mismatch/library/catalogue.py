# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Catalogue of all effects, by name, of full-size vehicles and their scale models."""

from __future__ import annotations

from functools import lru_cache

from adk_ros.mismatch.library.command_effects import COMMANDS
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.library.sensor_effects import SENSORS
from adk_ros.mismatch.library.vehicle_effects import VEHICLE

EFFECTS: dict[str, Effect] = {effect.name: effect for effect in (*VEHICLE, *COMMANDS, *SENSORS)}
INSEPARABLE = (
    frozenset({"drive_torque_gain", "wheel_radius"}),
    frozenset({"rolling_resistance", "torque_offset"}),
)
"""
Effects that no recording of driving forward separates: torque enters as torque over radius, and
both drags are constant forces.
"""
COMMON_CAUSES = (("front_tyre_stiffness", "rear_tyre_stiffness"),)
"""
Effects that one change of a car, other tyres, has together. Each may gain little without the
other, which keeps the balance of the car.
"""


@lru_cache(maxsize=16)
def effects_of(size: float) -> dict[str, Effect]:
    """Return the catalogue with the bounds and thresholds of a vehicle's scale of lengths."""
    if size == 1.0:
        return EFFECTS
    return {name: effect.similar(size) for name, effect in EFFECTS.items()}
