# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each effect is missing physics or a calibration; a calibration has parameters of decoding."""

from __future__ import annotations

from dataclasses import fields

import pytest

from adk_ros.mismatch.library.catalogue import EFFECTS, INSEPARABLE
from adk_ros.mismatch.library.categories import (
    AMBIGUOUS,
    CALIBRATION,
    CATEGORIES,
    PARAMETERS,
    PHYSICS,
    category_of,
    is_ambiguous,
)
from adk_ros.ros.parameter_table import defaults
from adk_ros.signals.decode import SensorConfig


def test_every_effect_of_the_catalogue_has_a_category() -> None:
    assert set(CATEGORIES) == set(EFFECTS)
    assert set(CATEGORIES.values()) == {PHYSICS, CALIBRATION}


def test_every_sensor_fault_is_a_calibration() -> None:
    # A calibration of the command, unlike that of a sensor, is part of the corrected model.
    sensors = {name for name, effect in EFFECTS.items() if effect.sensor}
    calibrations = {name for name in EFFECTS if category_of(name) == CALIBRATION}
    assert calibrations - sensors == {"steering_offset", "steering_ratio", "drive_torque_gain"}
    assert sensors < calibrations


def test_every_calibration_but_a_filter_is_corrected_by_parameters_of_the_node() -> None:
    decoding = {each.name for each in fields(SensorConfig)}
    for effect, names in PARAMETERS.items():
        assert set(names) <= decoding
        assert set(names) <= set(defaults())
        assert bool(names) == (effect != "odometry_filter")


def test_a_calibration_of_the_command_may_be_physics() -> None:
    assert set(AMBIGUOUS) <= set(PARAMETERS)
    assert {name for name in PARAMETERS if not EFFECTS[name].sensor} <= set(AMBIGUOUS)
    # What no recording separates from physics is never a calibration alone.
    for pair in INSEPARABLE:
        if len({category_of(name) for name in pair}) > 1:
            assert all(name in AMBIGUOUS for name in pair if category_of(name) == CALIBRATION)


@pytest.mark.parametrize(
    ("name", "alternatives", "ambiguous"),
    [
        ("gyro_scale", [], False),
        ("imu_bias", ["imu_tilt"], False),
        ("imu_tilt", ["road_bank"], True),
        ("steering_ratio", [], True),
        ("aero_drag", ["headwind"], False),
        ("steering_delay", ["clock_offset"], True),
    ],
)
def test_ambiguous_causes(name: str, alternatives: list[str], ambiguous: bool) -> None:
    assert is_ambiguous(name, alternatives) is ambiguous
