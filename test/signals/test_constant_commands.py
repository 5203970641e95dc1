# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Constant commands are reported where the motion that they cause varies, and only there."""

import math
from collections.abc import Callable

import pytest

from adk_ros.signals.constant_commands import ConstantCommands

Motion = Callable[[float], tuple[float, float]]
Commands = Callable[[float], tuple[float, float]]


def bends(time_s: float) -> tuple[float, float]:
    """v_x, m/s, and yaw rate, rad/s."""
    return 12.0 + 2.0 * math.sin(0.5 * time_s), 0.3 * math.sin(0.7 * time_s)


def constant(torque: float, delta: float) -> Commands:
    return lambda _: (torque, delta)


def warnings(motion: Motion, commands: Commands, duration_s: float = 30.0) -> list[str]:
    check = ConstantCommands()
    for tick in range(round(40 * duration_s)):
        check.add(10**18 + tick * 25_000_000, *motion(tick / 40), commands(tick / 40))
    return check.warnings()


@pytest.mark.parametrize("torque", [0.0, 0.3, 120.0])
def test_a_constant_torque_or_pedal(torque: float) -> None:
    (text,) = warnings(bends, lambda t: (torque, 0.05 * math.sin(0.7 * t)))
    assert text.startswith(f"the command's torque is {torque:g} throughout while v_x varies by 4")
    assert "record the wheel torque or a pedal position" in text
    assert "v_x can only be predicted in reduced scope" in text


def test_a_constant_steering_angle() -> None:
    (text,) = warnings(bends, lambda t: (100.0 * math.sin(t), 0.0))
    assert text.startswith("the steering angle is 0 rad throughout while the yaw rate varies")
    assert "v_y and yaw rate can only be predicted in reduced scope" in text


def test_both() -> None:
    assert len(warnings(bends, constant(0.0, 0.0))) == 2


def test_commands_that_vary_once_are_measured() -> None:
    assert warnings(bends, lambda t: (float(t > 20.0), 0.01 * (t > 20.0))) == []


def test_time_and_motion_are_needed() -> None:
    assert warnings(bends, constant(0.0, 0.0), 9.5) == []
    assert len(warnings(bends, constant(0.0, 0.0), 10.5)) == 2
    straight = warnings(lambda t: (bends(t)[0], 0.05 * math.sin(9.0 * t)), constant(0.0, 0.0))
    assert ["torque" in text for text in straight] == [True]
    cruise = warnings(lambda t: (12.0 + 0.2 * math.sin(9.0 * t), bends(t)[1]), constant(90.0, 0.0))
    assert ["steering" in text for text in cruise] == [True]
    assert warnings(lambda t: (0.2 * math.sin(9.0 * t), 0.0), constant(0.0, 0.0)) == []


def test_scale_models() -> None:
    """A 1:10 car at 1 m/s."""
    slow = warnings(lambda t: (bends(t)[0] / 12.0, bends(t)[1]), lambda t: (0.0, 0.01 * t))
    assert ["torque is 0 throughout" in text for text in slow] == [True]
