# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The map from pedals to force: against the truth of a simulated drive."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from helpers.wheels import GRIP_FREE, driven, pedals

from adk_ros.calibration.criteria import PERIOD_S
from adk_ros.calibration.grid import smooth
from adk_ros.calibration.pedal_map import ForceTable, PedalSamples, fit_pedals

MASS, RADIUS = 2070.0, 0.325


@lru_cache
def samples() -> PedalSamples:
    drive = driven(GRIP_FREE, 300.0, 0.5)
    t = (drive.stamp_ns - drive.stamp_ns[0]) * 1e-9
    at = np.arange(0.0, t[-1], PERIOD_S)
    noise = np.random.default_rng(0).normal(0.0, 0.1, t.size)
    held = np.clip(np.searchsorted(t, at, side="right") - 1, 0, None)
    throttle, brake = pedals(drive)
    return PedalSamples(
        smooth(np.interp(at, t, MASS * (drive.a[:, 0] + noise))),
        smooth(np.interp(at, t, drive.x[:, 0])),
        np.ones_like(at),
        throttle[held],
        brake[held],
        None,
    )


def test_the_force_of_the_pedals_is_found() -> None:
    fit = fit_pedals(samples())
    assert fit is not None
    assert fit.throttle is not None
    assert fit.brake is not None
    assert fit.full_throttle is not None
    assert fit.full_brake is not None
    drive = driven(GRIP_FREE, 300.0, 0.5)
    throttle, brake = pedals(drive)
    force = fit.throttle(throttle, drive.x[:, 0]) + fit.brake(brake)
    truth = drive.u[:, 0] / RADIUS
    # The rotating inertia of the wheels (2 %) and the squat of the body are not modelled.
    assert np.sqrt(np.mean((force - truth) ** 2)) < 0.15 * np.sqrt(np.mean(truth**2))
    assert fit.r_squared > 0.95
    assert fit.full_throttle.low < fit.full_throttle.value < fit.full_throttle.high
    assert fit.full_brake.high < 0.0
    for row in fit.throttle.force:
        assert row[0] == 0.0
        assert (np.diff(row) >= 0.0).all()
    assert (np.diff(fit.brake.force[0]) <= 0.0).all()


def test_a_delay_of_the_force_is_found() -> None:
    given = samples()
    late = given.later(-0.3)
    fit, delayed = fit_pedals(given), fit_pedals(late)
    assert fit is not None
    assert delayed is not None
    assert delayed.delay_s == pytest.approx(fit.delay_s + 0.3, abs=0.051)


def test_pedals_of_another_drive_explain_nothing() -> None:
    given = samples()
    assert given.throttle is not None
    assert given.brake is not None
    half = given.throttle.size // 2
    other = given._replace(
        throttle=np.roll(given.throttle, half), brake=np.roll(given.brake, half)
    )
    fit = fit_pedals(other)
    assert fit is not None
    assert fit.r_squared < 0.3


def test_too_little_driving_gives_no_map() -> None:
    given = samples()
    short = [None if x is None else x[:1000] for x in given]
    assert fit_pedals(PedalSamples(*short)) is None  # type: ignore[arg-type]


def test_gears_have_maps_of_their_own() -> None:
    random = np.random.default_rng(2)
    count = round(300.0 / PERIOD_S)
    step = round(3.0 / PERIOD_S)
    throttle = np.repeat(random.uniform(0.0, 1.0, count // step), step)
    gear = np.repeat(random.integers(1, 4, count // step), step).astype(np.float64)
    speed = np.repeat(random.uniform(5.0, 30.0, count // step), step)
    force = smooth(9000.0 / gear * throttle) - 0.5 * speed**2
    ones = np.ones(throttle.size)
    fit = fit_pedals(PedalSamples(force, speed, ones, throttle, None, gear))
    assert fit is not None
    assert fit.throttle is not None
    assert fit.throttle.at is not None
    assert fit.throttle.by == "gear"
    assert np.array_equal(fit.throttle.at, [1.0, 2.0, 3.0])
    half = fit.throttle(np.full(3, 0.5), gear=fit.throttle.at)
    assert half == pytest.approx([4500.0, 2250.0, 1500.0], rel=0.05)
    assert fit.brake is None


def test_a_table_interpolates_and_is_constant_beyond_its_ends() -> None:
    table = ForceTable(
        np.array([0.0, 1.0]),
        np.array([[0.0, 100.0], [0.0, 50.0]]),
        "speed",
        np.array([10.0, 20.0]),
    )
    pedal, speed = np.array([0.5, 2.0, 1.0, 1.0]), np.array([15.0, 0.0, 40.0, 10.0])
    assert table(pedal, speed) == pytest.approx([37.5, 100.0, 50.0, 100.0])
