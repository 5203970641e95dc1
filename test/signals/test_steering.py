# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A measured steering angle replaces the commanded one (Autoware's SteeringReport)."""

from __future__ import annotations

import math
import random
from types import SimpleNamespace

import pytest

from adk_ros.signals.align import Aligner
from adk_ros.signals.channels import Flag, Reading, Sample, Source
from adk_ros.signals.commands import COMMAND_TYPES
from adk_ros.signals.decode import Decoder, RefusedMessage, SensorConfig

MS = 1_000_000
START = 1_000_000 * MS


def readings(steering_until_s: float, duration_s: float = 3.0) -> list[Reading]:
    """Return odometry at 50 Hz, commands at 30 Hz (angle 0.5), measured angle 0.1 t at 40 Hz."""
    items = []
    for k in range(int(duration_s * 50)):
        items.append(Reading(Source.ODOMETRY, START + 20 * k * MS, (10.0 + 0.01 * k, 0.0, 0.0)))
    for k in range(int(duration_s * 30)):
        items.append(Reading(Source.COMMAND, START + 3 * MS + 33 * k * MS, (100.0, 0.5)))
    for k in range(int(steering_until_s * 40)):
        items.append(Reading(Source.STEERING, START + 7 * MS + 25 * k * MS, (0.1 * 0.025 * k,)))
    return sorted(items, key=lambda r: r.stamp_ns)


def aligned(items: list[Reading]) -> list[Sample]:
    aligner = Aligner()
    return [sample for item in items for sample in aligner.push(item)]


def test_measured_angle_is_used_with_the_commanded_torque() -> None:
    for sample in aligned(readings(3.0))[4:]:
        since = (sample.stamp_ns - START - 7 * MS) // (25 * MS)
        assert sample.u[0] == 100.0
        assert sample.u[1] == pytest.approx(0.1 * 0.025 * since)
        assert sample.learnable


def test_without_reports_the_commanded_angle_is_used() -> None:
    assert {sample.u for sample in aligned(readings(0.0))} == {(100.0, 0.5)}


def test_stopped_reports_are_flagged_and_give_way_to_the_command() -> None:
    """The car may be on a straight long after a report of a bend."""
    samples = aligned(readings(1.0))
    late = [s for s in samples if s.stamp_ns > START + 1_500 * MS]
    assert late
    # Half a second after the last report, at about 0.98 s, the car counts as one without.
    for item in late:
        is_stale = item.stamp_ns <= START + 1_480 * MS
        assert bool(item.flags & Flag.COMMAND_STALE) is is_stale
    early = [s for s in samples if START + 1_100 * MS < s.stamp_ns < START + 1_450 * MS]
    assert early
    assert all(s.flags & Flag.COMMAND_STALE for s in early)
    assert {s.u for s in late} == {(100.0, 0.5)}


def test_arrival_order_has_no_effect() -> None:
    items = readings(3.0)
    delays = random.Random(3)
    shuffled = sorted(items, key=lambda r: r.stamp_ns + delays.uniform(0.0, 4.0) * MS)
    assert shuffled != items
    assert aligned(shuffled)[4:-8] == aligned(items)[4 : len(aligned(shuffled)) - 8]


def autoware(**fields: float) -> SimpleNamespace:
    return SimpleNamespace(stamp=SimpleNamespace(sec=5, nanosec=7), **fields)


def test_decoding_of_a_report() -> None:
    config = SensorConfig(command_type="autoware_control", mass=1500.0, wheel_radius=0.3)
    decoder = Decoder(config)
    read = decoder.decode(Source.STEERING, autoware(steering_tire_angle=0.2))
    assert read == Reading(Source.STEERING, 5_000_000_007, (0.2,))
    for bad in (math.nan, math.inf, 3.0):
        with pytest.raises(RefusedMessage, match="steering angle"):
            decoder.decode(Source.STEERING, autoware(steering_tire_angle=bad))
    with pytest.raises(RefusedMessage, match="not the expected message"):
        decoder.decode(Source.STEERING, autoware())
    assert COMMAND_TYPES["autoware_control"].steering_msgtype
