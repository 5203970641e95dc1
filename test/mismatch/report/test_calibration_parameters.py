# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The proposed parameters turn a reading with the identified error into that without."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.mismatch_report import identified

from adk_ros.mismatch.inference.result import Interval
from adk_ros.mismatch.library.categories import PARAMETERS
from adk_ros.mismatch.report.calibration_parameters import calibrated, parameters_by_effect
from adk_ros.numerics.constants import GRAVITY
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.frames import rotation

PLAIN = SensorConfig()
KNOWN = SensorConfig(
    accelerometer_scale=0.5,
    accelerometer_bias=(0.1, -0.2),
    gyro_scale=1.1,
    gyro_bias=0.01,
    odometry_scale=3.6,
    torque_scale=-1.0,
    steering_ratio=15.0,
    steering_offset=0.02,
    imu_delay=0.03,
    command_delay=0.05,
)
BOTH = pytest.mark.parametrize("known", [PLAIN, KNOWN])


def corrected(known: SensorConfig, found: dict[str, dict[str, float]]) -> SensorConfig:
    """Return the configuration with the proposed parameters."""
    new = calibrated(found, known)
    changes: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in new.items()}
    return replace(known, **changes)


@BOTH
def test_biases_and_scales_of_the_imu(known: SensorConfig) -> None:
    truth = np.array([1.3, -2.1, 0.4])
    bias, scale = np.array([0.245, -0.196, 0.008]), 1.02
    # What was read with the known parameters has the identified errors.
    read = truth * [1.0, 1.0, scale] + bias
    raw = (
        known.accelerometer_scale * read[0] + known.accelerometer_bias[0],
        known.accelerometer_scale * read[1] + known.accelerometer_bias[1],
        known.gyro_scale * read[2] + known.gyro_bias,
    )
    found = {
        "imu_bias": dict(zip(("ax", "ay", "gyro"), bias, strict=True)),
        "gyro_scale": {"scale": scale},
    }
    assert corrected(known, found).imu(*raw) == pytest.approx(tuple(truth), abs=1e-5)


@BOTH
def test_scale_of_odometry(known: SensorConfig) -> None:
    raw = known.odometry_scale * 1.04 * 20.0
    new = corrected(known, {"odometry_scale": {"scale": 1.04}})
    assert new.velocity(raw, 0.0, 0.0)[0] == pytest.approx(20.0)


@BOTH
def test_the_command_becomes_what_the_wheels_do(known: SensorConfig) -> None:
    found = {
        "steering_ratio": {"scale": 0.93},
        "steering_offset": {"offset": 0.012},
        "drive_torque_gain": {"scale": 0.86},
    }
    joint, raw_torque = 0.9, 500.0
    torque, delta = known.command(raw_torque, joint / known.steering_ratio)
    new = corrected(known, found)
    assert new.command(raw_torque, joint / new.steering_ratio) == pytest.approx(
        (0.86 * torque, 0.93 * delta + 0.012), rel=1e-3
    )


@BOTH
@pytest.mark.parametrize(
    ("delay", "offset"), [(0.05, 0.0), (-0.05, 0.0), (0.0, 0.1), (0.04, -0.2)]
)
def test_the_stamps_agree_with_each_other(
    known: SensorConfig, delay: float, offset: float
) -> None:
    new = corrected(known, {"imu_delay": {"delay": delay}, "clock_offset": {"offset": offset}})
    late = np.array([new.imu_delay, new.odometry_delay, new.command_delay])
    before = np.array([known.imu_delay, known.odometry_delay, known.command_delay])
    assert late.min() >= 0.0
    errors = np.array([delay, 0.0, -offset])
    assert np.diff(late) == pytest.approx(np.diff(before + errors), abs=1e-6)


def test_a_tilt_is_the_mounting_angle() -> None:
    roll, pitch = 0.025, -0.02
    reading = np.array([-GRAVITY * np.sin(pitch), GRAVITY * np.sin(roll), GRAVITY])
    new = calibrated({"imu_tilt": {"roll": roll, "pitch": pitch}}, PLAIN)
    level = rotation(*new["imu_rotation"]) @ reading
    assert np.abs(level[:2]).max() < 0.01
    turned = replace(PLAIN, imu_rotation=(0.0, 0.0, np.pi))
    both = calibrated({"imu_tilt": {"roll": roll, "pitch": 0.0}}, turned)
    at_rest = rotation(0.0, 0.0, np.pi).T @ [0.0, GRAVITY * np.sin(roll), GRAVITY * np.cos(roll)]
    assert rotation(*both["imu_rotation"]) @ at_rest == pytest.approx([0, 0, GRAVITY], abs=1e-5)


def test_the_position_of_the_imu_keeps_a_rotation_that_the_recording_gives() -> None:
    arm = {"imu_lever_arm": {"x": 0.8, "y": 0.4}}
    assert calibrated(arm, PLAIN) == {"imu_position": [0.8, 0.4]}
    # Transforms are used only where position and rotation are zero.
    published = replace(PLAIN, imu_position=(0.2, 0.0), imu_rotation=(0.0, 0.0, 0.1))
    assert calibrated(arm, published) == {
        "imu_position": [1.0, 0.4],
        "imu_rotation": [0.0, 0.0, 0.1],
    }


@pytest.mark.parametrize("name", PARAMETERS)
def test_each_calibration_changes_its_parameters_only(name: str) -> None:
    one = identified(name, 1.02, 1.01, 1.03)
    changed = set(parameters_by_effect([one], PLAIN)[name])
    assert changed <= set(PARAMETERS[name])
    assert bool(changed) == bool(PARAMETERS[name])


def test_physics_has_no_parameter() -> None:
    assert parameters_by_effect([identified()], PLAIN) == {}


def test_values_have_the_digits_of_their_intervals_and_leave_out_the_insignificant() -> None:
    sizes = {
        "ax": Interval(0.24531, 0.2433, 0.2473, "m/s^2"),
        "ay": Interval(0.001, -0.002, 0.004, "m/s^2"),
        "gyro": Interval(0.0, -1e-4, 1e-4, "rad/s"),
    }
    bias = replace(identified("imu_bias"), parameters=sizes)
    proposed = parameters_by_effect([bias], PLAIN)
    assert proposed == {"imu_bias": {"accelerometer_bias": [0.2453, 0.0]}}


def test_a_calibration_that_is_conditional_does_not_change_one_that_is_not() -> None:
    late = identified("imu_delay", 0.05, 0.049, 0.051)
    early = identified("clock_offset", 0.1, 0.099, 0.101)
    both = parameters_by_effect([late, early], PLAIN)
    assert both == {
        "imu_delay": {"imu_delay": 0.05},
        "clock_offset": {"imu_delay": 0.15, "odometry_delay": 0.1},
    }
