# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sensor axes and positions against rigid bodies whose motion is known exactly."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adk_ros.signals.frames import LeverArm, rotation, shift_velocity

ANGLE = st.floats(-math.pi, math.pi)
ARM = (0.8, -0.35)
PERIOD_NS = 5_000_000


@pytest.mark.parametrize(
    ("angles", "sensor", "body"),
    [
        ((0.0, 0.0, math.pi / 2), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((0.0, math.pi / 2, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
        ((math.pi / 2, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        ((math.pi, 0.0, 0.0), (0.0, 1.0, 1.0), (0.0, -1.0, -1.0)),
        ((0.0, 0.0, math.pi), (1.0, 1.0, 1.0), (-1.0, -1.0, 1.0)),
    ],
)
def test_quarter_and_half_turns(
    angles: tuple[float, ...], sensor: tuple[float, ...], body: tuple[float, ...]
) -> None:
    assert rotation(*angles) @ sensor == pytest.approx(body, abs=1e-15)


@given(ANGLE, ANGLE, ANGLE)
def test_rotation_is_fixed_axis_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> None:
    turn = rotation(roll, pitch, yaw)
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    parts = rotation(0, 0, yaw) @ rotation(0, pitch, 0) @ rotation(roll, 0, 0)
    assert turn == pytest.approx(parts, abs=1e-14)


@given(st.floats(-30, 30), st.floats(-5, 5), st.floats(-2, 2), st.floats(-3, 3), st.floats(-3, 3))
def test_velocity_of_another_point(
    v_x: float, v_y: float, rate: float, x: float, y: float
) -> None:
    """Against the two points' positions a moment later, in the frame at rest."""
    moment = 1e-6
    turned = rotation(0.0, 0.0, rate * moment)[:2, :2]
    went = np.array([v_x, v_y]) * moment + turned @ (x, y) - (x, y)
    assert shift_velocity(v_x, v_y, rate, x, y) == pytest.approx(went / moment, abs=1e-4)


def test_velocity_at_the_centre_of_gravity() -> None:
    """REP-105: base_link under the rear axle; at the centre v_y is l_r r more."""
    assert shift_velocity(20.0, 0.01, 0.5, 1.35, 0.0) == pytest.approx((20.0, 0.685))


def rigid_body(time_s: float, rate0: float, gain: float, omega: float) -> tuple[float, ...]:
    """Return yaw rate and force at the centre and at ARM, of a body that turns unevenly."""
    rate = rate0 + gain * math.sin(omega * time_s)
    angular = gain * omega * math.cos(omega * time_s)
    a_x, a_y = 2.0 + math.sin(time_s), -1.0 + 0.5 * time_s
    x, y = ARM
    return (
        rate,
        a_x,
        a_y,
        a_x - angular * y - rate * rate * x,
        a_y + angular * x - rate * rate * y,
    )


def run(arm: LeverArm, steps: int, *motion: float, begin: int = 0) -> list[float]:
    """Errors of the force at the centre, step by step."""
    wrong = []
    for k in range(begin, begin + steps):
        rate, a_x, a_y, at_x, at_y = rigid_body(k * PERIOD_NS * 1e-9, *motion)
        got = arm.compensate(10**9 + k * PERIOD_NS, at_x, at_y, rate)
        wrong.append(math.dist(got, (a_x, a_y)))
    return wrong


def test_lever_arm_at_constant_yaw_rate_is_exact() -> None:
    assert max(run(LeverArm(*ARM), 50, 0.7, 0.0, 1.0)) < 1e-12


def test_lever_arm_at_constant_yaw_acceleration_settles_to_exact() -> None:
    arm = LeverArm(*ARM)
    wrong = []
    for k in range(400):
        rate = 0.5 * k * PERIOD_NS * 1e-9
        at = (-0.5 * ARM[1] - rate**2 * ARM[0], 0.5 * ARM[0] - rate**2 * ARM[1])
        wrong.append(math.hypot(*arm.compensate(1 + k * PERIOD_NS, *at, rate)))
    assert wrong[0] > 0.3
    assert max(wrong[200:]) < 1e-8
    assert max(np.diff(wrong)) < 1e-12


def test_lever_arm_while_the_yaw_rate_swings() -> None:
    """The filter's 50 ms lag: at 0.5 Hz 16 % of the angular part are left, not all of it."""
    motion = (0.3, 0.4, math.pi)
    wrong = run(LeverArm(*ARM), 2000, *motion)[100:]
    angular = 0.4 * math.pi * math.hypot(*ARM)
    assert max(wrong) < 0.18 * angular
    assert max(wrong) > 0.05 * angular


def test_no_arm_no_change() -> None:
    arm = LeverArm(0.0, 0.0)
    for k, rate in enumerate((0.0, 5.0, -5.0)):
        assert arm.compensate(1 + k * PERIOD_NS, 1.5, -2.5, rate) == (1.5, -2.5)


@pytest.mark.parametrize("hours", [1, -1])
def test_a_stray_stamp_does_not_disable_the_arm(hours: int) -> None:
    motion = (0.3, 0.4, math.pi)
    plain, struck = LeverArm(*ARM), LeverArm(*ARM)
    run(plain, 200, *motion)
    run(struck, 200, *motion)
    struck.compensate(10**9 + hours * 3_600_000_000_000, 0.0, 0.0, 3.0)
    expected = run(plain, 400, *motion, begin=200)
    got = run(struck, 400, *motion, begin=200)
    assert got[250:] == pytest.approx(expected[250:], abs=1e-6)


def test_duplicates_and_late_readings_leave_the_filter_alone() -> None:
    motion = (0.3, 0.4, math.pi)
    plain, struck = LeverArm(*ARM), LeverArm(*ARM)
    for k in range(200):
        rate, _, _, at_x, at_y = rigid_body(k * PERIOD_NS * 1e-9, *motion)
        stamp_ns = 10**9 + k * PERIOD_NS
        expected = plain.compensate(stamp_ns, at_x, at_y, rate)
        assert struck.compensate(stamp_ns, at_x, at_y, rate) == expected
        assert struck.compensate(stamp_ns, at_x, at_y, rate) == expected
        struck.compensate(stamp_ns - 7_000_000, 1.0, 1.0, -2.0)


def test_a_gap_and_a_reset_start_the_filter_anew() -> None:
    """Otherwise the rate's change over the gap would pass for an acceleration."""
    for begin_again in ("gap", "reset"):
        arm = LeverArm(*ARM)
        run(arm, 100, 0.0, 0.0, 1.0)
        begin = 101
        if begin_again == "reset":
            arm.reset()
        else:
            begin = 101 + 100
        wrong = run(arm, 50, 2.0, 0.0, 1.0, begin=begin)
        assert max(wrong) < 1e-12


def test_arms_are_finite_whatever_comes() -> None:
    @given(st.lists(st.tuples(st.integers(1, 10**18), st.floats(-1146, 1146)), max_size=30))
    def check(readings: list[tuple[int, float]]) -> None:
        arm = LeverArm(*ARM)
        for stamp_ns, rate in readings:
            assert all(map(math.isfinite, arm.compensate(stamp_ns, 1.0, 1.0, rate)))

    check()
