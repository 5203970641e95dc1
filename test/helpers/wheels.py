# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated drive as a table of what a car's own bus has: wheel speeds, GPS speed, pedals."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from adk_ros.importing.map_loading import checked_map
from adk_ros.importing.recording_import import ImportedRecording, read_channels
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.seven_dof import OMEGA

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
GPS_DELAY_S = 0.2
GRIP_FREE = "town"
"""A drive without wheel spin, in which torque is force times radius."""
FULL_DRIVE, FULL_BRAKE, THROTTLE_EXPONENT = 3000.0, 9000.0, 1.5
"""N·m at full pedals, and torque ~ throttle^1.5."""


@lru_cache
def driven(name: str, seconds: float, torque_split_front: float) -> SimulatedDrive:
    """Return a drive of a car with a share of its torque at the front axle."""
    scenario = load_scenario(name)
    changed = dict(scenario.vehicle_changes) | {"torque_split_front": torque_split_front}
    scenario = scenario.model_copy(update={"vehicle_changes": changed})
    return simulate(scenario, duration_s=seconds)


def bus(drive: SimulatedDrive, gps_delay_s: float = 0.0) -> pd.DataFrame:
    """Return the channels in SI units at 40 Hz; GPS speed at 10 Hz, with empty cells between."""
    t = (drive.stamp_ns - drive.stamp_ns[0]) * 1e-9
    random = np.random.default_rng(1)
    speed = np.hypot(drive.x[:, 0], drive.x[:, 1])
    gps = np.interp(t - gps_delay_s, t, speed) + random.normal(0.0, 0.05, t.size)
    gps[np.arange(t.size) % 4 > 0] = np.nan
    columns = {
        "t": t,
        "a_x": drive.a[:, 0],
        "a_y": drive.a[:, 1],
        "yaw_rate": drive.x[:, 2] + random.normal(0.0, 0.002, t.size),
        "torque": drive.u[:, 0],
        "delta": drive.u[:, 1],
        "gps_speed": gps,
    }
    # Resolution of a speed on a bus: 0.01 km/h at a radius of 0.3 m.
    step = 0.01 / 3.6 / 0.3
    for i, wheel in enumerate(WHEELS):
        columns[f"wheel_speed_{wheel}"] = step * np.round(drive.states[:, OMEGA + i] / step)
    return pd.DataFrame(columns)


def pedals(drive: SimulatedDrive) -> tuple[np.ndarray, np.ndarray]:
    """Return the pedals (n,) that give a drive its torque: throttle with a soft start, brake."""
    torque = drive.u[:, 0]
    throttle = (np.maximum(torque, 0.0) / FULL_DRIVE) ** (1.0 / THROTTLE_EXPONENT)
    return throttle, np.maximum(-torque, 0.0) / FULL_BRAKE


@lru_cache
def town() -> SimulatedDrive:
    """Return a minute and a half in town of a car with front-wheel drive."""
    return driven("town", 90.0, 1.0)


@lru_cache
def table() -> pd.DataFrame:
    """Return the bus of the car in town, with a GPS receiver that is late."""
    return bus(town(), GPS_DELAY_S)


UNITS = {
    "a_x": "m/s^2", "a_y": "m/s^2", "yaw_rate": "rad/s", "torque": "N m", "delta": "rad",
    "gps_speed": "m/s", **{f"wheel_speed_{wheel}": "rad/s" for wheel in WHEELS},
}  # fmt: skip


def bus_map(*without: str, **computed: Any) -> dict[str, Any]:
    """Return the map of `bus`, with computed channels."""
    channels = {
        name: {"column": name, "unit": unit} for name, unit in UNITS.items() if name not in without
    }
    time = {"column": "t", "unit": "s"}
    return {"time": time, "channels": channels, "computed": computed}


def read_frame(folder: Path, frame: pd.DataFrame, content: dict[str, Any]) -> ImportedRecording:
    """Read a table, written as CSV into a folder, by a map."""
    path = folder / "a.csv"
    frame.to_csv(path, index=False)
    return read_channels([path], checked_map("m", content), "m", [])
