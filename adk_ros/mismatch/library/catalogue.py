# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Catalogue of all effects, by name."""

from __future__ import annotations

from adk_ros.mismatch.library.command_effects import COMMANDS
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.library.sensor_effects import SENSORS
from adk_ros.mismatch.library.vehicle_effects import VEHICLE

EFFECTS: dict[str, Effect] = {effect.name: effect for effect in (*VEHICLE, *COMMANDS, *SENSORS)}
