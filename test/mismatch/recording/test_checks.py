# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that cannot be analysed are refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.mismatch import case
from helpers.mismatch_drive import drive_of, simulated_car

from adk_ros.errors import DataError
from adk_ros.mismatch.recording.checks import (
    check_recording,
    check_same_vehicle,
    check_torque_unit,
    check_vehicle,
    torque_response_text,
)
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.recording.implied_values import (
    ImpliedMass,
    implied_mass,
    steering_unit,
)
from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.run_inputs import no_terms


def scaled(stream: str, column: int, factor: float) -> Callable[[SensorLog], SensorLog]:
    def change(log: SensorLog) -> SensorLog:
        values = getattr(log, stream).copy()
        values[:, column] *= factor
        return replace(log, **{stream: values})

    return change


SAMPLE = Path(__file__).resolve().parents[3] / "bags" / "handling"


def stationary(log: SensorLog) -> SensorLog:
    return replace(log, odometry=0.001 * log.odometry)


def test_a_valid_recording_passes_all_checks() -> None:
    check_recording(case().simulation)
    check_recording(case().recording)
    check_same_vehicle(case().simulation, case().recording)
    check_vehicle(case().nominal, case().simulation)


def frozen(log: SensorLog) -> SensorLog:
    """Odometry repeats a reading for a second, ten times."""
    odometry, pose = log.odometry.copy(), log.pose.copy()
    for begin in np.linspace(5.0, log.duration_s - 5.0, 10):
        rows = (log.odometry_s >= begin) & (log.odometry_s < begin + 1.0)
        odometry[rows], pose[rows] = odometry[rows][0], pose[rows][0]
    return replace(log, odometry=odometry, pose=pose)


def test_odometry_that_freezes_has_no_wrong_unit() -> None:
    """When it goes on, the position jumps by a second's way."""
    log = frozen(case().recording)
    check_recording(log)
    with pytest.raises(DataError, match=r"odometry's v_x is .* looks like km/h"):
        check_recording(scaled("odometry", 0, 3.6)(log))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda log: log.between(0.0, 10.0), "overlap for 10.0 s"),
        (stationary, "slower than 2 m/s for 100 % of the recording"),
        (scaled("imu", 1, -1.0), "the IMU's a_y has its sign flipped"),
        (scaled("imu", 0, -1.0), "the IMU's a_x has its sign flipped"),
        (scaled("imu", 2, -1.0), "gyro's yaw rate has its sign flipped"),
        (scaled("odometry", 2, -1.0), "odometry's yaw rate has its sign flipped"),
        (scaled("command", 1, -1.0), "steering angle has its sign flipped"),
        (scaled("command", 0, -1.0), "torque has its sign flipped"),
        (scaled("imu", 2, 180.0 / np.pi), "looks like deg/s, the topic must carry rad/s"),
        (scaled("odometry", 2, 180.0 / np.pi), "looks like deg/s, the topic must carry rad/s"),
        (
            scaled("odometry", 0, 3.6),
            "looks like km/h, the topic must carry m/s (a factor of 3.6)",
        ),
        (scaled("odometry", 0, 1.0 / 3.6), "was converted from km/h twice"),
        (scaled("command", 1, 57.3), "its unit is not rad at the road wheels"),
        (scaled("imu", 1, 1.0 / 9.81), "looks like g, the topic must carry m/s²"),
        (scaled("odometry", 2, 0.0), "yaw rate is 0 throughout"),
    ],
)
def test_an_invalid_recording_is_refused(
    change: Callable[[SensorLog], SensorLog], message: str
) -> None:
    with pytest.raises(DataError) as error:
        check_recording(change(case().recording))
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (scaled("odometry", 1, 0.0), "v_y is 0 throughout"),
        (scaled("command", 0, 0.0), "torque is 0 throughout"),
        (scaled("command", 1, 0.0), "steering angle is 0 throughout"),
    ],
)
def test_only_a_simulation_needs_every_channel(
    change: Callable[[SensorLog], SensorLog], message: str
) -> None:
    straight = drive_of(simulated_car(), no_terms(6000), 60.0, steered=0.0)
    check_recording(change(straight))
    with pytest.raises(DataError, match=message):
        check_recording(change(case().simulation), is_simulation=True)


def test_a_car_that_turns_needs_a_steering_angle() -> None:
    with pytest.raises(DataError, match="steering angle is 0 throughout"):
        check_recording(scaled("command", 1, 0.0)(case().recording))


def test_recordings_without_a_common_speed_are_refused() -> None:
    with pytest.raises(DataError, match="do not overlap"):
        check_same_vehicle(case().simulation, scaled("odometry", 0, 4.0)(case().recording))


def test_a_power_limit_does_not_contradict_the_vehicle_file() -> None:
    c = case("power_limit", power=3e4)
    radius, inertia = c.nominal.wheel_radius, 4.0 * c.nominal.wheel_inertia
    overall = implied_mass(c.recording, radius, inertia)
    at_low_power = implied_mass(c.recording, radius, inertia, power_share=0.3)
    assert overall is not None
    assert at_low_power is not None
    # Torque beyond the power limit accelerates nothing: the implied mass is too high.
    assert overall.value > 1.5 * at_low_power.value
    assert not overall.is_accurate
    assert at_low_power.value == pytest.approx(c.nominal.mass, rel=0.15)
    check_vehicle(c.nominal, c.recording)


@pytest.mark.parametrize("factor", [0.6, 0.85, 1.21, 1.7, 5.0])
def test_a_vehicle_file_of_another_mass_is_refused(factor: float) -> None:
    nominal = case().nominal
    other = nominal.model_copy(update={"mass": factor * nominal.mass})
    with pytest.raises(DataError, match="the torque response implies a mass of") as error:
        check_vehicle(other, case().simulation)
    # The message gives the value to correct it with.
    implied = float(str(error.value).split("a mass of ")[1].split(" kg")[0])
    assert implied == pytest.approx(nominal.mass, rel=0.02)
    # Or the radius with which the torque accelerates that mass, with its interval.
    words = str(error.value).split("the radius would be ")[1].rstrip("m)")
    radius, interval = words.split(" m, ")
    low, high = (float(x) for x in interval.split(" to "))
    assert low <= float(radius) <= high
    assert float(radius) * factor == pytest.approx(nominal.wheel_radius, rel=0.02)


@cache
def sample() -> SensorLog:
    return read_sensor_log(SAMPLE)


@pytest.mark.parametrize("factor", [0.5, 0.8, 0.9, 1.0, 1.1, 1.2, 1.5, 2.0])
def test_the_sample_recording_knows_its_mass(factor: float) -> None:
    """Its part of low power explains little of the acceleration, the whole explains it well."""
    log, nominal = sample(), load_nominal_vehicle("imdv")
    other = nominal.model_copy(update={"mass": factor * nominal.mass})
    if factor == 1.0:
        check_vehicle(other, log)
        return
    with pytest.raises(DataError, match="the torque response implies a mass of 20"):
        check_vehicle(other, log)


def test_a_wheel_of_another_radius_is_refused() -> None:
    nominal = case().nominal
    other = nominal.model_copy(update={"wheel_radius": 1.2 * nominal.wheel_radius})
    with pytest.raises(DataError, match="correct its mass, wheel_radius or wheel_inertia"):
        check_vehicle(other, case().simulation)


def test_the_implied_mass_is_that_of_the_car_with_an_interval() -> None:
    c = case()
    found = implied_mass(c.simulation, c.nominal.wheel_radius, 4.0 * c.nominal.wheel_inertia)
    assert found is not None
    assert found.low < found.value < found.high
    assert found.value == pytest.approx(c.nominal.mass, rel=0.02)
    random = np.random.default_rng(0).normal(size=c.simulation.command.shape)
    unrelated = replace(c.simulation, command=c.simulation.command + 1e5 * random)
    assert implied_mass(unrelated, c.nominal.wheel_radius) is None


def test_the_check_returns_what_the_simulation_implies() -> None:
    c = case()
    found = check_vehicle(c.nominal, c.simulation)
    assert found is not None
    assert found.is_accurate
    assert found.value == pytest.approx(c.nominal.mass, rel=0.08)


def test_implied_mass_and_radius_are_stated_next_to_those_of_the_file() -> None:
    nominal = case().nominal.model_copy(update={"mass": 2000.0, "wheel_radius": 0.3})
    implied = ImpliedMass(2100.0, 2080.0, 2120.0, 0.99)
    said = torque_response_text(implied, nominal)
    assert said == (
        "the simulation's torque response implies a mass of 2100 kg (2080 to 2120; vehicle file "
        "2000) with a wheel radius of 0.3 m (vehicle file), or, with the file's mass, a wheel "
        "radius of 0.315 m (0.312 to 0.318)"
    )
    nominal._assumed = frozenset({"wheel_radius"})
    assert "with a wheel radius of 0.3 m (assumed)" in torque_response_text(implied, nominal)
    uncertain = torque_response_text(implied._replace(determination=0.6), nominal)
    assert uncertain.endswith(
        "explain only 60 % of the acceleration: these intervals may be too narrow"
    )
    assert "implies no mass" in torque_response_text(None, nominal)


def test_a_torque_in_kilonewton_metres_is_named() -> None:
    c = case()
    wrong = scaled("command", 0, 1e-3)(c.recording)
    with pytest.raises(DataError, match=r"it looks like kN·m, the topic must carry N·m"):
        check_torque_unit(wrong, c.nominal.mass, c.nominal.wheel_radius)
    check_torque_unit(c.recording, c.nominal.mass, c.nominal.wheel_radius)
    # A simulation in kN·m has no other mass than its vehicle file.
    with pytest.raises(DataError, match=r"it looks like kN·m, the topic must carry N·m"):
        check_vehicle(c.nominal, scaled("command", 0, 1e-3)(c.simulation))
    pedal = scaled("command", 0, 1.0 / 5000.0)(c.recording)
    check_torque_unit(pedal, c.nominal.mass, c.nominal.wheel_radius)


def test_a_pedal_of_the_simulation_is_no_negative_mass() -> None:
    """A torque that the spin inertia of the wheels alone would consume is none."""
    c = case()
    with pytest.raises(DataError, match=r"about 30\d\d times too small for a car of") as error:
        check_vehicle(c.nominal, scaled("command", 0, 1.0 / 3000.0)(c.simulation))
    assert "a pedal position or another unit" in str(error.value)
    assert "-" not in str(error.value)


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (180.0 / np.pi, "degrees at the road wheels"),
        (16.0, "the hand-wheel angle in rad: a ratio of about 1"),
        (16.0 * 180.0 / np.pi, "the hand-wheel angle in degrees: a ratio of about 1"),
        (1.0, ""),
    ],
)
def test_the_unit_of_the_steering_angle_is_named(factor: float, said: str) -> None:
    found = steering_unit(scaled("command", 1, factor)(case().recording))
    assert found.startswith(said)
    assert bool(found) == bool(said)


def test_the_odometry_period_is_the_median_interval() -> None:
    log = case().recording
    gap = np.append(log.odometry_s[:10], log.odometry_s[10:] + 5.0)
    assert replace(log, odometry_s=gap).odometry_period_s == pytest.approx(0.02)
