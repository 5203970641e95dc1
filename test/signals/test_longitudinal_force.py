# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sign and unit of a_x against the change of v_x; slopes, noise and calm driving say nothing."""

import math
import random
from collections.abc import Callable

import pytest
from helpers.train import drive

from adk_ros.numerics.constants import GRAVITY
from adk_ros.signals.align import Aligner
from adk_ros.signals.longitudinal_force import LongitudinalForce
from adk_ros.signals.plausibility import Plausibility

Acceleration = Callable[[float], float]


def level(_: float) -> float:
    return 0.0


def driver(time_s: float) -> float:
    """Acceleration, m/s²: every 4 s the driver changes between 1 and -1 m/s²."""
    return 1.0 if time_s % 8.0 < 4.0 else -1.0


def compared(
    acceleration: Acceleration,
    specific_force: Acceleration,
    duration_s: float = 60.0,
    odometry_hz: float = 50.0,
    noise: float = 0.05,
) -> LongitudinalForce:
    """Return the check after a drive; `noise`: of v_x, m/s, and ten times that of a_x, m/s²."""
    check, source = LongitudinalForce(), random.Random(0)
    v_x, latest = 15.0, (0, 15.0)
    for tick in range(round(40 * duration_s)):
        time_s = tick / 40
        v_x += acceleration(time_s) / 40
        if (time_s * odometry_hz) % 1.0 < odometry_hz / 40:
            latest = tick * 25_000_000, v_x + source.gauss(0.0, noise)
        a_x = specific_force(time_s) + source.gauss(0.0, 10.0 * noise)
        check.add(*latest, 0.0, a_x)
    return check


@pytest.mark.parametrize("odometry_hz", [10.0, 40.0])
@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.0, ""),
        (1.1, ""),
        (-1.0, "opposite sign of the change of odometry's v_x: x must point forward"),
        (1.0 / GRAVITY, "it looks like g, the topic must carry m/s²"),
        (-1.0 / GRAVITY, "times the change of odometry's v_x: check the units"),
        (1.0 / 3.6, "times the change of odometry's v_x: check the units"),
        (3.6, "times the change of odometry's v_x: check the units"),
    ],
)
def test_factor(factor: float, words: str, odometry_hz: float) -> None:
    noise = 0.005 if abs(factor) < 0.2 else 0.05
    check = compared(
        driver, lambda t: factor * driver(t), 80.0, odometry_hz=odometry_hz, noise=noise
    )
    assert check.factor == pytest.approx(factor, rel=0.15)
    if words:
        (text,) = check.warnings()
        assert words in text
        assert "`adk check`" in text or "topic must carry" in text
    else:
        assert check.warnings() == []


def test_an_offset_and_a_constant_grade_do_not_matter() -> None:
    check = compared(driver, lambda t: driver(t) + 0.08 * GRAVITY + 0.3)
    assert check.factor == pytest.approx(1.0, abs=0.1)


def hills(time_s: float) -> float:
    """g times the grade, m/s²: 8 % on hills of 200 m at 15 m/s."""
    return GRAVITY * 0.08 * math.sin(2.0 * math.pi / 200.0 * 15.0 * time_s)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8])
def test_hills_that_the_driver_half_compensates_do_not_decide(share: float) -> None:
    """The car is slower uphill although it is driven harder: a_x and dv_x/dt are opposite."""
    check = compared(
        lambda t: (share - 1.0) * hills(t), lambda t: share * hills(t), 300.0, noise=0.05
    )
    assert check.factor is None
    assert check.warnings() == []


def test_hills_do_not_hide_the_driver() -> None:
    right = compared(lambda t: driver(t) - 0.2 * hills(t), lambda t: driver(t) + 0.8 * hills(t))
    wrong = compared(lambda t: driver(t) - 0.2 * hills(t), lambda t: -driver(t) - 0.8 * hills(t))
    assert right.warnings() == []
    assert "opposite sign" in wrong.warnings()[0]


def test_calm_driving_and_noise_do_not_decide() -> None:
    assert compared(lambda t: 0.4 * driver(t), lambda t: -0.4 * driver(t), 200.0).factor is None
    assert compared(level, level, 200.0, noise=0.2).warnings() == []


def test_few_changes_do_not_decide() -> None:
    assert compared(driver, lambda t: -driver(t), 20.0).warnings() == []
    assert compared(driver, lambda t: -driver(t), 80.0).warnings() != []


def test_a_standstill_at_the_end_forgets_nothing() -> None:
    def until_80(acceleration: Acceleration) -> Acceleration:
        return lambda t: acceleration(t) if t < 80.0 else 0.0

    check = compared(until_80(driver), until_80(lambda t: -driver(t)), 300.0)
    assert "opposite sign" in check.warnings()[0]


def test_pauses_of_odometry_are_left_out() -> None:
    """Between two readings 5 s apart nothing is known of the speed."""
    check = LongitudinalForce()
    for block in range(100):
        for tick in range(200):
            check.add(block * 5_000_000_000, 3.0 * (block % 2), 0.0, 1.0 + 0.01 * tick)
    assert check.factor is None


@pytest.mark.parametrize("name", ["mountain", "xyz_edges"])
def test_simulated_hills(name: str) -> None:
    found = {}
    for sign in (1.0, -1.0):
        check, aligner = Plausibility(), Aligner()
        readings = drive(name, 120.0).readings
        turned = (
            r._replace(values=(sign * r.values[0], *r.values[1:])) if r.source == 0 else r
            for r in readings
        )
        for reading in check.watch(turned):
            for sample in aligner.push(reading):
                check.add(sample)
        found[sign] = check.warnings()
    assert found[1.0] == []
    assert ["opposite sign of the change" in text for text in found[-1.0]] == [True]
