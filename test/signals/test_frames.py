# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sensor rotation and lever arm, compared with exactly known rigid-body motion."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adk_ros.signals.corrections import SensorCorrections
from adk_ros.signals.frames import LeverArm, odometry_velocity, pose_of, rotation, shift_velocity

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
    """Compared with the displacement of the point after a short time."""
    dt = 1e-6
    rotated = rotation(0.0, 0.0, rate * dt)[:2, :2]
    displacement = np.array([v_x, v_y]) * dt + rotated @ (x, y) - (x, y)
    assert shift_velocity(v_x, v_y, rate, x, y) == pytest.approx(displacement / dt, abs=1e-4)


def test_velocity_at_the_centre_of_gravity() -> None:
    """REP-105: base_link under the rear axle; v_y at the centre of gravity is larger by l_r r."""
    assert shift_velocity(20.0, 0.01, 0.5, 1.35, 0.0) == pytest.approx((20.0, 0.685))


def rigid_body(time_s: float, rate0: float, gain: float, omega: float) -> tuple[float, ...]:
    """Return yaw rate, force at the centre and force at ARM, for a varying yaw rate."""
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
    """Return the errors of the force at the centre, per step."""
    error = []
    for k in range(begin, begin + steps):
        rate, a_x, a_y, at_x, at_y = rigid_body(k * PERIOD_NS * 1e-9, *motion)
        got = arm.compensate(10**9 + k * PERIOD_NS, at_x, at_y, rate)
        error.append(math.dist(got, (a_x, a_y)))
    return error


def test_lever_arm_at_constant_yaw_rate_is_exact() -> None:
    assert max(run(LeverArm(*ARM), 50, 0.7, 0.0, 1.0)) < 1e-12


def test_lever_arm_at_constant_yaw_acceleration_settles_to_exact() -> None:
    arm = LeverArm(*ARM)
    error = []
    for k in range(400):
        rate = 0.5 * k * PERIOD_NS * 1e-9
        at = (-0.5 * ARM[1] - rate**2 * ARM[0], 0.5 * ARM[0] - rate**2 * ARM[1])
        error.append(math.hypot(*arm.compensate(1 + k * PERIOD_NS, *at, rate)))
    assert error[0] > 0.3
    assert max(error[200:]) < 1e-8
    assert max(np.diff(error)) < 1e-12


def test_lever_arm_with_oscillating_yaw_rate() -> None:
    """The filter lag of 50 ms leaves 16 % of the angular part at 0.5 Hz."""
    motion = (0.3, 0.4, math.pi)
    error = run(LeverArm(*ARM), 2000, *motion)[100:]
    angular = 0.4 * math.pi * math.hypot(*ARM)
    assert max(error) < 0.18 * angular
    assert max(error) > 0.05 * angular


def test_zero_arm_changes_nothing() -> None:
    arm = LeverArm(0.0, 0.0)
    for k, rate in enumerate((0.0, 5.0, -5.0)):
        assert arm.compensate(1 + k * PERIOD_NS, 1.5, -2.5, rate) == (1.5, -2.5)


@pytest.mark.parametrize("hours", [1, -1])
def test_implausible_stamp_has_no_lasting_effect(hours: int) -> None:
    motion = (0.3, 0.4, math.pi)
    plain, disturbed = LeverArm(*ARM), LeverArm(*ARM)
    run(plain, 200, *motion)
    run(disturbed, 200, *motion)
    disturbed.compensate(10**9 + hours * 3_600_000_000_000, 0.0, 0.0, 3.0)
    expected = run(plain, 400, *motion, begin=200)
    got = run(disturbed, 400, *motion, begin=200)
    assert got[250:] == pytest.approx(expected[250:], abs=1e-6)


def test_duplicates_and_late_readings_do_not_affect_the_filter() -> None:
    motion = (0.3, 0.4, math.pi)
    plain, disturbed = LeverArm(*ARM), LeverArm(*ARM)
    for k in range(200):
        rate, _, _, at_x, at_y = rigid_body(k * PERIOD_NS * 1e-9, *motion)
        stamp_ns = 10**9 + k * PERIOD_NS
        expected = plain.compensate(stamp_ns, at_x, at_y, rate)
        assert disturbed.compensate(stamp_ns, at_x, at_y, rate) == expected
        assert disturbed.compensate(stamp_ns, at_x, at_y, rate) == expected
        disturbed.compensate(stamp_ns - 7_000_000, 1.0, 1.0, -2.0)


def test_gap_and_reset_restart_the_filter() -> None:
    """Otherwise the change of the yaw rate over the gap would count as an acceleration."""
    for event in ("gap", "reset"):
        arm = LeverArm(*ARM)
        run(arm, 100, 0.0, 0.0, 1.0)
        begin = 101
        if event == "reset":
            arm.reset()
        else:
            begin = 101 + 100
        error = run(arm, 50, 2.0, 0.0, 1.0, begin=begin)
        assert max(error) < 1e-12


def test_compensation_is_finite_for_any_readings() -> None:
    @given(st.lists(st.tuples(st.integers(1, 10**18), st.floats(-1146, 1146)), max_size=30))
    def check(readings: list[tuple[int, float]]) -> None:
        arm = LeverArm(*ARM)
        for stamp_ns, rate in readings:
            assert all(map(math.isfinite, arm.compensate(stamp_ns, 1.0, 1.0, rate)))

    check()


def test_odometry_velocity_undoes_decoding() -> None:
    point, axes = (1.35, -0.2), 0.3
    read = (20.0, 0.4, 0.5)
    v_x, v_y, rate = SensorCorrections(odometry_rotation=axes).velocity(*read)
    at_point = np.array([[*shift_velocity(v_x, v_y, rate, *point), rate]])
    np.testing.assert_allclose(odometry_velocity(at_point, point, axes), [read])


def test_a_heading_is_that_of_the_vehicle() -> None:
    z, w = np.sin(0.5 * 0.7), np.cos(0.5 * 0.7)
    orientation = SimpleNamespace(x=0.0, y=0.0, z=z, w=w)
    pose = SimpleNamespace(position=SimpleNamespace(x=1.0, y=2.0), orientation=orientation)
    msg = SimpleNamespace(pose=SimpleNamespace(pose=pose))
    assert pose_of(msg) == pytest.approx((1.0, 2.0, 0.7))
    assert pose_of(msg, 0.3) == pytest.approx((1.0, 2.0, 0.4))


def test_one_wrong_gyro_value_does_not_last() -> None:
    """At 200 Hz it would be an angular acceleration of thousands of rad/s^2 for 0.1 s."""
    arm = LeverArm(1.0, 0.0)
    for k in range(40):
        wrong = 500.0 if k == 20 else 0.0
        _, a_y = arm.compensate(10**9 + k * 5_000_000, 0.0, 0.0, wrong)
        assert k == 20 or abs(a_y) < 1.0
