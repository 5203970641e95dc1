# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Parameters of decoding that correct the identified calibrations.

The values contain those that the recording was read with. With a reading s0 x + b0 of a value
x = k v + c, the scale is s0 k and the bias b0 + s0 c (as in `calibration.known_errors`). A
road-wheel angle k (u / n0 - o0) + o of a command u has the ratio n0 / k and the offset k o0 - o.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from adk_ros.mismatch.inference.result import IdentifiedEffect
from adk_ros.mismatch.library.categories import CALIBRATION, category_of, is_ambiguous
from adk_ros.mismatch.library.effect import TIME
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.extrinsics import roll_pitch_yaw
from adk_ros.signals.frames import rotation

Parameters = dict[str, Any]
"""Number or list of numbers by parameter name, as a parameter file has them."""

_DECIMALS = 6
_DELAYS = ("imu_delay", "odometry_delay", "command_delay")


def is_unconditional(identified: IdentifiedEffect) -> bool:
    """Whether a calibration is one in any case, throughout the recording."""
    ambiguous = is_ambiguous(identified.effect.name, identified.alternatives)
    return identified.kind != TIME and not ambiguous


def parameters_by_effect(
    effects: Sequence[IdentifiedEffect], sensors: SensorConfig
) -> dict[str, Parameters]:
    """
    Return the parameters to set for each identified calibration, by the name of the effect.

    Those of unconditional calibrations hold together; those of a conditional one contain all
    calibrations. Empty where no parameter corrects a calibration.
    """
    calibrations = [each for each in effects if category_of(each.effect.name) == CALIBRATION]
    found = {each.effect.name: _significant(each) for each in calibrations}
    unconditional = {x.effect.name for x in calibrations if is_unconditional(x)}
    certain = calibrated({name: found[name] for name in unconditional}, sensors)
    total = calibrated(found, sensors)
    out = {}
    for name, sizes in found.items():
        values = certain if name in unconditional else total
        out[name] = {k: values[k] for k in calibrated({name: sizes}, sensors) if k in values}
    return out


def calibrated(found: dict[str, dict[str, float]], sensors: SensorConfig) -> Parameters:
    """
    Return the parameters that differ from `sensors`, with which the recording was read.

    `found`: parameters of each calibration by the name of the effect, those that are absent are
    neutral.
    """
    new = _of_imu(found, sensors) | _delays(found, sensors) | _of_command(found, sensors)
    new["odometry_scale"] = sensors.odometry_scale * _size(found, "odometry_scale", "scale", 1.0)
    changed = {
        name: value
        for name, value in new.items()
        if _rounded(value) != _rounded(getattr(sensors, name))
    }
    # The transforms of a recording are not used where one of the two is given.
    for one, other in (("imu_rotation", "imu_position"), ("imu_position", "imu_rotation")):
        if one in changed and any(getattr(sensors, other)):
            changed.setdefault(other, getattr(sensors, other))
    return {name: _rounded(value) for name, value in changed.items()}


def _of_imu(found: dict[str, dict[str, float]], sensors: SensorConfig) -> Parameters:
    known_x, known_y = sensors.accelerometer_bias
    scale = sensors.accelerometer_scale
    new: Parameters = {
        "accelerometer_bias": (
            known_x + scale * _size(found, "imu_bias", "ax"),
            known_y + scale * _size(found, "imu_bias", "ay"),
        ),
        "gyro_bias": sensors.gyro_bias + sensors.gyro_scale * _size(found, "imu_bias", "gyro"),
        "gyro_scale": sensors.gyro_scale * _size(found, "gyro_scale", "scale", 1.0),
        "imu_position": (
            sensors.imu_position[0] + _size(found, "imu_lever_arm", "x"),
            sensors.imu_position[1] + _size(found, "imu_lever_arm", "y"),
        ),
    }
    if "imu_tilt" in found:
        roll, pitch = (_size(found, "imu_tilt", name) for name in ("roll", "pitch"))
        # The vector of the IMU, turned by its mounting angles, is that of the vehicle.
        total = rotation(roll, pitch, 0.0) @ rotation(*sensors.imu_rotation)
        new["imu_rotation"] = tuple(roll_pitch_yaw(total))
    return new


def _of_command(found: dict[str, dict[str, float]], sensors: SensorConfig) -> Parameters:
    ratio = _size(found, "steering_ratio", "scale", 1.0)
    offset = _size(found, "steering_offset", "offset")
    return {
        "steering_ratio": _quotient(sensors.steering_ratio, ratio),
        "steering_offset": ratio * sensors.steering_offset - offset,
        "torque_scale": _quotient(
            sensors.torque_scale, _size(found, "drive_torque_gain", "scale", 1.0)
        ),
    }


def _quotient(known: float, scale: float) -> float:
    """Return a known ratio over a scale, four digits of it; unchanged without a scale."""
    return known if scale == 1.0 else float(f"{known / scale:.4g}")


def _delays(found: dict[str, dict[str, float]], sensors: SensorConfig) -> Parameters:
    """Return by how much the stamps of each stream are late; only their differences count."""
    late = [
        sensors.imu_delay + _size(found, "imu_delay", "delay"),
        sensors.odometry_delay,
        # Commands that act later than their stamps say are stamped early.
        sensors.command_delay - _size(found, "clock_offset", "offset"),
    ]
    earliest = min(0.0, *late)
    return {name: value - earliest for name, value in zip(_DELAYS, late, strict=True)}


def _significant(identified: IdentifiedEffect) -> dict[str, float]:
    """Return the sizes whose 90 % intervals exclude neutral, with the digits that they justify."""
    neutral = {p.name: p.neutral for p in identified.effect.parameters}
    out = {}
    for name, x in identified.parameters.items():
        width = x.high - x.low
        if x.low <= neutral[name] <= x.high:
            continue
        digits = 1 - math.floor(math.log10(0.5 * width)) if 0.0 < width < math.inf else _DECIMALS
        out[name] = round(x.value, digits)
    return out


def _size(
    found: dict[str, dict[str, float]], effect: str, parameter: str, neutral: float = 0.0
) -> float:
    return found.get(effect, {}).get(parameter, neutral)


def _rounded(value: Any) -> Any:
    """Return a number, or several as a list, as a parameter file has them; no minus zero."""
    if isinstance(value, tuple):
        return [round(float(x), _DECIMALS) + 0.0 for x in value]
    return round(float(value), _DECIMALS) + 0.0
