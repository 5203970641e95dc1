# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of the watch: its drives, its threshold, and an event as it scores it."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.bench.mismatch import watch_bench as bench
from adk_ros.bench.mismatch.watch_drives import EVENTS, WatchedDrive
from adk_ros.cli.main import main
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import TIME


def test_the_sets_of_drives_share_no_seed_and_cover_plants_and_events() -> None:
    calibration = bench.clean_drives(bench.CALIBRATION, 5.0)
    clean = bench.clean_drives(bench.CLEAN, 5.0)
    events = bench.event_drives([1.0, 0.5], 2)
    seeds = [(d.family, d.seed) for d in (*calibration, *clean, *(d for _, d in events))]
    assert len(set(seeds)) == len(seeds) == 10 + 10 + 28
    assert {name for name, _ in events} == set(EVENTS)
    assert {d.plant for _, d in events} == {"seven_dof", "fourteen_dof", "spring_car"}
    assert all(TIME in EFFECTS[name].activations for name in EVENTS.values())


def test_the_threshold_has_the_required_rate() -> None:
    random = np.random.default_rng(0)
    maxima = random.gumbel(9.0, 2.0, 4000)
    threshold, rate = bench.calibrated_threshold(maxima.tolist())
    segment_h = 300.0 / 3600.0
    exact = 9.0 - 2.0 * np.log(-np.log1p(-bench.FALSE_ALARMS_PER_HOUR * segment_h))
    assert threshold == pytest.approx(exact, rel=0.03)
    assert rate < bench.FALSE_ALARMS_PER_HOUR
    again = random.gumbel(9.0, 2.0, 100_000)
    assert np.mean(again > threshold) / segment_h == pytest.approx(0.1, rel=0.35)


@pytest.mark.slow(seconds=25)
def test_an_event_on_a_plant_of_its_own_is_named_and_scored() -> None:
    drive = WatchedDrive(
        "spring_car", 1, 0, bench.EVENT_DRIVE_S, "town", "steering_lag", 1.0, bench.ONSET_S
    )
    result = bench.run_event("steering lag", drive)
    assert result.named == "steering_lag"
    assert result.credit == 1.0
    assert 0.0 < result.delay_s < 30.0
    assert abs(result.onset_error_s) < 2.0
    assert result.error < 0.05
    assert result.false_alarms == 0
    line = bench.event_line(result)
    assert line.startswith("1.00  steering lag")
    (verdict, alarms) = bench.event_lines([result])
    assert verdict.startswith("PASS strength 1: 1.000 of 1 events")
    assert alarms.endswith("0 in 1 drives")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--hours", "-1"], "--hours"),
        (["--rounds", "1000"], "--rounds"),
        (["--strength", "9"], "--strength"),
        (["--out", "/nowhere/results.jsonl"], "/nowhere"),
    ],
)
def test_wrong_options_are_refused(
    arguments: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "watch", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert named in line
