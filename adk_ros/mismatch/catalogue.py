# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All effects that the tool knows by name."""

from __future__ import annotations

from adk_ros.mismatch.catalogue_commands import COMMANDS
from adk_ros.mismatch.catalogue_sensors import SENSORS
from adk_ros.mismatch.catalogue_vehicle import VEHICLE
from adk_ros.mismatch.effect import Effect

EFFECTS: dict[str, Effect] = {effect.name: effect for effect in (*VEHICLE, *COMMANDS, *SENSORS)}
