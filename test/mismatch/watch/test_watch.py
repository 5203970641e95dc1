# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The watch on drives of the surrogate itself: what it reports, and what it survives."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.watch import ONSET_S, changing_drive, surrogate, watched

from adk_ros.bench.mismatch.watch_drives import readings_of
from adk_ros.mismatch.inference.result import EXPLAINED, UNKNOWN
from adk_ros.mismatch.watch.change import FINAL, PRELIMINARY, WITHDRAWN, Change
from adk_ros.mismatch.watch.settings import ALARM_THRESHOLD
from adk_ros.mismatch.watch.watch import CHANGED, LEARNING, WAITING, WATCHING, Watch
from adk_ros.signals.channels import Reading, Source


@pytest.mark.slow(seconds=8)
def test_a_change_is_named_with_onset_and_size_and_becomes_the_reference() -> None:
    watch, changes = watched(changing_drive(mass=200.0, yaw_inertia=220.0))
    assert [c.state for c in changes] == [PRELIMINARY, PRELIMINARY, FINAL]
    for change in changes:
        assert change.verdict == EXPLAINED
        assert change.best.effect.name == "payload"
        assert change.best.onset_s == change.onset_s == pytest.approx(ONSET_S, abs=1.0)
        assert change.onset_low_s <= change.onset_s <= change.onset_high_s
        mass = change.best.parameters["mass"]
        assert mass.low < 200.0 < mass.high
        assert mass.value == pytest.approx(200.0, abs=15.0)
    first = changes[0]
    assert first.alarm_s - ONSET_S <= 20.0
    assert changes[-1].until_s - ONSET_S <= 90.0
    content = json.loads(json.dumps(changes[-1].as_dict()))
    assert content["schema"] == 2
    assert content["effects"][0]["name"] == "payload"
    competitors = changes[-1].best.competitors
    assert [x["name"] for x in content["effects"][0]["competing_effects"]] == [
        x.name for x in competitors
    ]
    assert content["onset"]["stamp_ns"] == pytest.approx((ONSET_S + 1.0) * 1e9, abs=1e9)
    assert "more mass" in content["sentence"]
    # The change is part of the model from now on, and a new reference is learnt.
    assert watch.state == LEARNING
    assert [x.effect.name for x in watch.base] == ["payload"]


@pytest.mark.slow(seconds=8)
def test_a_biased_accelerometer_is_named_a_tilt_unless_the_gyro_is_biased_too() -> None:
    log = changing_drive()
    for gyro, name in ((0.0, "imu_tilt"), (0.006, "imu_bias")):
        biased = log.imu.copy()
        biased[log.imu_s > 130.0] += (0.15, 0.0, gyro)
        _, changes = watched(replace(log, imu=biased), until_s=160.0)
        assert [c.state for c in changes] == [PRELIMINARY]
        assert changes[0].best.effect.name == name
        assert changes[0].onset_s == pytest.approx(130.0, abs=0.5)


@pytest.mark.slow(seconds=8)
def test_a_clean_drive_raises_no_alarm() -> None:
    watch, changes = watched(changing_drive())
    assert changes == []
    assert watch.state == WATCHING
    assert 0.0 < watch.statistic < ALARM_THRESHOLD
    assert watch.blocks_used > 40


@pytest.mark.slow(seconds=8)
def test_what_no_effect_explains_is_unknown() -> None:
    log = changing_drive()
    shaken = log.imu.copy()
    late = log.imu_s > ONSET_S
    # A rattling IMU: a constant share, which some effect takes, and an oscillation.
    shaken[late, 1] += 0.3 + 0.6 * np.sin(2.0 * np.pi * 1.3 * log.imu_s[late])
    _, changes = watched(replace(log, imu=shaken))
    assert changes[-1].state == FINAL
    assert changes[-1].verdict == UNKNOWN
    assert changes[-1].channels[0] == "imu_a_y"
    content = changes[-1].as_dict()
    assert content["effects"] == []
    assert content["closest"]
    assert "no effect of the catalogue explains it" in content["sentence"]


def test_a_restart_forgets_all() -> None:
    watch, _ = watched(changing_drive(), until_s=25.0)
    assert watch.blocks_used > 0
    watch.restart()
    watch.push(Reading(Source.IMU, 2_000_000_000, (0.0, 0.0, 0.0)))
    assert watch.restarts == 1
    assert watch.state == WAITING
    assert watch.blocks_used == 0
    assert watch.buffer.start_ns == 2_000_000_000


def test_a_gap_is_skipped() -> None:
    log = changing_drive()
    watch = Watch(surrogate(), lambda change: None)
    for reading, pose in readings_of(log):
        at_s = 1e-9 * reading.stamp_ns - 1.0
        if at_s > 60.0:
            break
        if not 30.0 < at_s < 44.0:
            watch.push(reading, pose)
            watch.run()
    assert watch.blocks_skipped >= 2
    assert 4 <= watch.blocks_used <= 9
    assert watch.restarts == 0


def test_a_car_that_stands_is_not_learnt() -> None:
    watch = Watch(surrogate(), lambda change: None)
    for i in range(6000):
        stamp = 1_000_000_000 + 10_000_000 * i
        watch.push(Reading(Source.IMU, stamp, (0.0, 0.0, 0.0)))
        if i % 2 == 0:
            watch.push(Reading(Source.ODOMETRY, stamp, (0.0, 0.0, 0.0)), (0.0, 0.0, 0.0))
            watch.push(Reading(Source.COMMAND, stamp, (0.0, 0.0)))
        watch.run()
    assert watch.blocks_used == 0
    assert watch.blocks_skipped > 0
    assert watch.reference_share == 0.0


@pytest.mark.slow(seconds=8)
def test_a_change_that_later_data_do_not_confirm_is_withdrawn() -> None:
    log = changing_drive()
    changes: list[Change] = []
    watch = Watch(surrogate(), changes.append)
    for reading, pose in readings_of(log):
        watch.push(reading, pose)
        while watch.step():
            # An alarm that one reading of the statistic raised, and the next ones do not.
            watch.threshold = 1.0 if watch.state != CHANGED and not changes else 40.0
    assert [c.state for c in changes] == [PRELIMINARY, WITHDRAWN]
    assert "withdrawn" in changes[-1].sentence()
    assert watch.base == ()
    assert watch.state == WATCHING
