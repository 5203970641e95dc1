# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Known errors of sensors: removed from the streams, and added to those that a check finds.

A check sees streams without the known errors, so that what it proposes is relative to them. With
a reading s0 x + b0 of a value x = k v + c, the error of the reading is the scale s0 k and the
bias b0 + s0 c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from adk_ros.calibration.finding import Finding
from adk_ros.calibration.streams import Stream
from adk_ros.signals.corrections import CORRECTIONS
from adk_ros.signals.decode import SensorConfig

_SCALE_OF = {
    "accelerometer_bias": "accelerometer_scale",
    "gyro_bias": "gyro_scale",
    "yaw_rate_bias": "yaw_rate_scale",
}
_OTHER_DELAY = {"imu_delay": "odometry_delay", "odometry_delay": "imu_delay"}
_DECIMALS = 6


def without_known_errors(stream: Stream, role: str, sensors: SensorConfig) -> Stream:
    """Return a stream as decoding returns it; `role`: "imu" (in vehicle axes), ..."""
    delay_s = {
        "imu": sensors.imu_delay,
        "odometry": sensors.odometry_delay,
        "command": sensors.command_delay,
    }[role]
    if role == "imu":
        a_x, a_y, w_z = sensors.imu(stream["a_x"], stream["a_y"], stream["w_z"])
        # Decoding does not use the other axes: they have the unit of these.
        a_z = stream["a_z"] / sensors.accelerometer_scale
        w_x, w_y = (stream[name] / sensors.gyro_scale for name in ("w_x", "w_y"))
        stream = stream.having(a_x=a_x, a_y=a_y, a_z=a_z, w_x=w_x, w_y=w_y, w_z=w_z)
    elif role == "odometry":
        # Turned axes mix both, so a v_y that is not measured would take v_x with it.
        unmeasured = np.isnan(stream["v_y"])
        v_x, v_y, rate = sensors.velocity(
            stream["v_x"], np.where(unmeasured, 0.0, stream["v_y"]), stream["yaw_rate"]
        )
        v_y = np.where(unmeasured, np.nan, v_y)
        heading = stream["heading"] - sensors.odometry_rotation
        stream = stream.having(v_x=v_x, v_y=v_y, yaw_rate=rate, heading=heading)
    else:
        torque, steering = sensors.command(stream["torque"], stream["steering"])
        stream = stream.having(torque=torque, steering=steering)
    return replace(stream, at_s=stream.at_s - delay_s) if delay_s else stream


def with_known_errors(
    findings: Sequence[Finding], sensors: SensorConfig
) -> tuple[list[Finding], SensorConfig]:
    """
    Return findings whose proposals contain the known errors, and the configuration with them.

    Proposals of `signals.corrections.CORRECTIONS` are relative to the streams before. Only the
    difference of the delays of IMU and odometry is found: a further delay of one first shortens a
    known delay of the other.
    """
    out, before = [], sensors
    for finding in findings:
        proposed: dict[str, Any] = {}
        for name, value in finding.parameters.items():
            if name in _OTHER_DELAY:
                proposed |= _delays(name, value, sensors)
            else:
                proposed[name] = (
                    _absolute(name, value, sensors, before) if name in CORRECTIONS else value
                )
        for name, known in proposed.items():
            change: dict[str, Any] = {name: tuple(known) if isinstance(known, list) else known}
            if name in CORRECTIONS or name == "imu_rotation":
                sensors = replace(sensors, **change)
        out.append(replace(finding, parameters=proposed))
    return out, sensors


def _delays(name: str, further_s: float, sensors: SensorConfig) -> dict[str, float]:
    """Return the delays that change where a stream is late by `further_s`."""
    other = _OTHER_DELAY[name]
    known_s, other_s = getattr(sensors, name), getattr(sensors, other)
    remaining_s = further_s - other_s
    changed = {other: max(0.0, -remaining_s)} if other_s > 0.0 else {}
    if remaining_s > 0.0:
        changed[name] = known_s + remaining_s
    return {key: round(value, _DECIMALS) for key, value in changed.items()}


def _absolute(name: str, value: Any, sensors: SensorConfig, before: SensorConfig) -> Any:
    known = getattr(sensors, name)
    if name.endswith("_scale"):
        return round(known * value, _DECIMALS)
    # Gyro and yaw rate are divided by the scale that is found before their bias is.
    scaled = before if name == "accelerometer_bias" else sensors
    factor = getattr(scaled, _SCALE_OF[name]) if name in _SCALE_OF else 1.0
    if isinstance(value, list):
        return [round(b + factor * x, _DECIMALS) for b, x in zip(known, value, strict=True)]
    return round(known + factor * value, _DECIMALS)
