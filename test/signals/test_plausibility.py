# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wrong units and signs are reported; correct data and too little data give no warning."""

import math
from collections.abc import Callable, Iterable

import pytest
from helpers.signals import drive, in_order

from adk_ros.signals.align import Aligner
from adk_ros.signals.channels import Reading, Source
from adk_ros.signals.plausibility import Plausibility

Change = Callable[[Reading], Reading]


def imu(a_x: float = 1.0, a_y: float = 1.0, rate: float = 1.0) -> Change:
    """Return a change that scales the IMU values."""

    def change(reading: Reading) -> Reading:
        if reading.source is not Source.IMU:
            return reading
        scaled = (v * k for v, k in zip(reading.values, (a_x, a_y, rate), strict=True))
        return reading._replace(values=tuple(scaled))

    return change


def found(readings: Iterable[Reading], plausibility: Plausibility | None = None) -> list[str]:
    plausibility = plausibility or Plausibility()
    aligner = Aligner()
    for reading in plausibility.watch(readings):
        for sample in aligner.push(reading):
            plausibility.add(sample)
    return plausibility.warnings()


@pytest.mark.parametrize("rates", [(200, 50, 40), (50, 10, 5), (1000, 200, 200)], ids=str)
def test_correct_data(rates: tuple[int, int, int]) -> None:
    assert found(in_order(drive(30.0, *rates, noise=0.02))) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (imu(rate=180.0 / math.pi), ["57 times odometry's", "deg/s", "rad/s"]),
        (imu(1 / 9.80665, 1 / 9.80665), ["looks like g", "m/s²"]),
        (imu(rate=-1.0), ["yaw rate has the opposite sign", "imu_rotation", "z must point up"]),
        (imu(a_y=-1.0), ["points out of the bend", "imu_rotation", "y must point left"]),
    ],
    ids=["deg/s", "g", "z down", "y right"],
)
def test_one_fault(change: Change, words: list[str]) -> None:
    warnings = found(map(change, in_order(drive(30.0, noise=0.02))))
    assert len(warnings) == 1
    assert all(word in warnings[0] for word in words)
    assert "\n" not in warnings[0]


def scale_model(reading: Reading) -> Reading:
    """Return the reading of a 1:10 car at 1 m/s in bends of 0.8 rad/s."""
    factors = {
        Source.IMU: (1 / 15, 2 / 15, 2.0),
        Source.ODOMETRY: (1 / 15, 1 / 15, 2.0),
        Source.COMMAND: (0.01, 1.0),
    }[reading.source]
    scaled = (v * k for v, k in zip(reading.values, factors, strict=True))
    return reading._replace(values=tuple(scaled))


@pytest.mark.parametrize(
    ("change", "words"),
    [(imu(a_y=-1.0), "points out of the bend"), (imu(1 / 9.80665, 1 / 9.80665), "looks like g")],
    ids=["y right", "g"],
)
def test_scale_models(change: Change, words: str) -> None:
    readings = [scale_model(reading) for reading in in_order(drive(60.0))]
    assert found(readings) == []
    (warning,) = found(map(change, readings))
    assert words in warning


def test_two_faults_at_once() -> None:
    """A driver that reports g and deg/s; an upside-down IMU with both signs flipped."""
    readings = in_order(drive(30.0))
    both = found(map(imu(1 / 9.80665, 1 / 9.80665, 180.0 / math.pi), readings))
    assert ["deg/s" in both[0], "looks like g" in both[1]] == [True, True]
    turned = found(map(imu(1.0, -1.0, -1.0), readings))
    assert ["opposite sign" in turned[0], "out of the bend" in turned[1]] == [True, True]


def test_too_little_data() -> None:
    wrong = imu(0.1, -0.1, 57.3)
    readings = in_order(drive(60.0))
    assert found([]) == []
    assert found(map(wrong, readings[:100])) == []
    straight = [
        r._replace(values=(r.values[0], 1e-3 * r.values[1], 1e-3 * r.values[2]))
        if r.source is not Source.COMMAND else r
        for r in readings
    ]  # fmt: skip
    assert found(map(wrong, straight)) == []


def test_standing_still_with_noise() -> None:
    readings = []
    for k, reading in enumerate(in_order(drive(60.0))):
        noise = (0.05 * math.sin(7919.0 * k * (i + 1)) for i in range(len(reading.values)))
        readings.append(reading._replace(values=tuple(noise)))
    assert found(readings) == []


def test_without_imu() -> None:
    assert found(in_order(drive(20.0, 0))) == []


def test_odometry_without_yaw_rate() -> None:
    """Some odometry reports zero: there is nothing to compare."""
    readings = [
        r._replace(values=(*r.values[:2], 0.0)) if r.source is Source.ODOMETRY else r
        for r in in_order(drive(30.0))
    ]  # fmt: skip
    (text,) = found(readings)
    assert text.startswith("odometry's yaw rate is 0 throughout")


def test_warning_ends_when_the_fault_is_fixed() -> None:
    plausibility = Plausibility()
    found(map(imu(rate=-1.0), in_order(drive(15.0))), plausibility)
    assert plausibility.warnings()
    found(in_order(drive(120.0, 50, 20, 20)), plausibility)
    assert plausibility.warnings() == []


def test_late_fault_is_found() -> None:
    """The memory is about two minutes, not the whole recording."""
    plausibility, aligner = Plausibility(), Aligner()
    wrong = imu(rate=-1.0)
    for reading in plausibility.watch(
        wrong(r) if k > 9000 else r for k, r in enumerate(in_order(drive(230.0, 50, 20, 20)))
    ):
        for sample in aligner.push(reading):
            plausibility.add(sample)
    assert len(plausibility.warnings()) == 1


def test_reset() -> None:
    plausibility = Plausibility()
    assert found(map(imu(rate=-1.0), in_order(drive(15.0))), plausibility)
    plausibility.reset()
    assert plausibility.warnings() == []
    for reading in in_order(drive(1.0)):
        plausibility.see(reading)
    assert plausibility.warnings() == []
