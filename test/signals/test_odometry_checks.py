# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Velocities in fixed axes and channels that are not measured are reported, and nothing else."""

import math
import random
from collections.abc import Callable

import pytest

from adk_ros.signals.channels import Reading, Source
from adk_ros.signals.odometry_checks import OdometryChecks

Motion = Callable[[float], tuple[float, float, float]]


def checked(motion: Motion, duration_s: float = 40.0, rate_hz: int = 50, x: float = 0.0) -> str:
    checks = OdometryChecks((x, 0.0))
    noise = random.Random(0)
    for step in range(round(duration_s * rate_hz)):
        values = tuple(value + noise.gauss(0.0, 0.02) for value in motion(step / rate_hz))
        checks.add(Reading(Source.ODOMETRY, 10**18 + step * 10**9 // rate_hz, values))
    return "; ".join(checks.warnings())


def bend(time_s: float) -> tuple[float, float, float]:
    """Both ways, 12 m/s, with side slip."""
    yaw_rate = 0.3 * math.sin(0.2 * time_s)
    return 12.0 + 2.0 * math.sin(0.1 * time_s), -0.8 * yaw_rate, yaw_rate


def heading(time_s: float) -> float:
    return 0.3 / 0.2 * (1.0 - math.cos(0.2 * time_s))


def in_odom(time_s: float) -> tuple[float, float, float]:
    v_x, v_y, yaw_rate = bend(time_s)
    c, s = math.cos(heading(time_s)), math.sin(heading(time_s))
    return c * v_x - s * v_y, s * v_x + c * v_y, yaw_rate


def drift(time_s: float) -> tuple[float, float, float]:
    """Side slip of 40 deg against the bend."""
    yaw_rate = 0.8 * math.sin(0.5 * time_s)
    slip = -0.9 * yaw_rate
    return 15.0 * math.cos(slip) + math.sin(time_s), 15.0 * math.sin(slip), yaw_rate


def spin(time_s: float) -> tuple[float, float, float]:
    """On ice: turns at 1.5 rad/s while it slides straight on."""
    return 10.0 * math.cos(1.5 * time_s), -10.0 * math.sin(1.5 * time_s), 1.5


@pytest.mark.parametrize("rate_hz", [10, 50, 200])
def test_axes_of_odom_are_recognised(rate_hz: int) -> None:
    text = checked(in_odom, rate_hz=rate_hz)
    assert text.startswith(
        "odometry's velocity turns with the heading: it looks like axes of odom"
    )


@pytest.mark.parametrize("motion", [bend, drift, spin])
@pytest.mark.parametrize("rate_hz", [10, 200])
def test_vehicle_axes_are_right(motion: Motion, rate_hz: int) -> None:
    assert checked(motion, rate_hz=rate_hz) == ""


def scale_model(motion: Motion) -> Motion:
    """Return the motion of a 1:10 car at 1 m/s, whose odometry is less noisy in proportion."""

    def scaled(time_s: float) -> tuple[float, float, float]:
        v_x, v_y, yaw_rate = motion(time_s)
        return v_x / 12.0, v_y / 12.0, yaw_rate

    return scaled


def test_axes_of_scale_models() -> None:
    assert checked(scale_model(in_odom)).startswith("odometry's velocity turns with the heading")
    assert checked(scale_model(bend)) == ""


def test_reversing_and_standing_are_right() -> None:
    assert checked(lambda t: (-bend(t)[0], bend(t)[1], bend(t)[2])) == ""
    assert checked(lambda t: (0.0, 0.0, 0.0)) == ""


def test_little_turning_does_not_decide() -> None:
    assert checked(in_odom, duration_s=4.0) == ""


def exact(values: Callable[[float], tuple[float, float, float]], x: float, s: float) -> list[str]:
    checks = OdometryChecks((x, 0.0))
    for step in range(round(50 * s)):
        v_x, v_y, rate = values(step / 50)
        checks.add(
            Reading(Source.ODOMETRY, 10**18 + step * 20_000_000, (v_x, v_y + x * rate, rate))
        )
    return checks.warnings()


def no_v_y(time_s: float) -> tuple[float, float, float]:
    return bend(time_s)[0], 0.0, bend(time_s)[2]


@pytest.mark.parametrize("x", [0.0, 1.3])
def test_a_velocity_that_is_never_measured_is_named(x: float) -> None:
    (text,) = exact(no_v_y, x, 20.0)
    assert text.startswith("odometry's v_y is ")
    assert text.endswith("it is not measured, and predictions of it are meaningless")
    (text,) = exact(lambda t: (bend(t)[0], bend(t)[1], 0.0), x, 20.0)
    assert text.startswith("odometry's yaw rate is 0 throughout")


def test_constant_channels_of_scale_models() -> None:
    (text,) = exact(scale_model(lambda t: (12.0 + 4.0 * math.sin(t), 0.0, 0.1)), 0.0, 20.0)[:1]
    assert text.startswith("odometry's v_y is 0 throughout")


def test_a_standing_car_with_noise_has_constant_channels() -> None:
    assert exact(lambda t: (0.2 * math.sin(9.0 * t), 0.0, 0.0), 0.0, 20.0) == []


def test_constant_channels_need_time_and_motion() -> None:
    assert exact(no_v_y, 0.0, 9.0) == []
    assert exact(lambda t: (12.0, 0.0, bend(t)[2]), 0.0, 20.0) == []
    assert exact(bend, 0.0, 20.0) == []
