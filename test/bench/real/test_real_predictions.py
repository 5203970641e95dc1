# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench real: what is predicted of real recordings, against naive predictors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.calibration import driven, write_streams

import adk_ros.bench.real.real_bench as real_bench
from adk_ros.bench.paper.training_jobs import BenchPlan
from adk_ros.bench.real.real_bench import PREDICTIONS, RealBench, bench_real
from adk_ros.bench.real.real_predictions import (
    RatioOutcome,
    largest_ratio,
    mean_ratio,
    shared_rows,
)
from adk_ros.bench.real.scores import criteria
from adk_ros.cli.main import main
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS, Record
from adk_ros.train.train_settings import TrainSettings

HALF = (0.5,) * 5


def outcome(*ratios: tuple[float, ...], **changes: object) -> RatioOutcome:
    default = RatioOutcome("car", "a", "a", "v_x", "known", ratios or (HALF,))
    return replace(default, **changes)  # type: ignore[arg-type]


def test_the_largest_ratio_is_that_of_the_mean_over_seeds() -> None:
    seeds = outcome((0.5, 0.5, 0.5, 0.5, 1.2), (0.5, 0.5, 0.5, 0.5, 0.8))
    other = outcome((0.5, 0.5, 1.1, 0.5, 0.5), tested_on="b", channel="v_y", commands="held")
    assert largest_ratio([seeds, other]) == (1.1, "car, b, v_y at 0.5 s, commands held")
    assert largest_ratio([seeds])[0] == pytest.approx(1.0)
    assert np.isnan(largest_ratio([])[0])


def test_vehicles_count_alike_and_only_by_the_rest_of_their_recordings() -> None:
    four = [outcome(channel=x) for x in ("v_x", "v_y", "yaw_rate")]
    other = outcome((1.0, 1.0, 1.0, 0.125, 1.0), vehicle="truck")
    ignored = [outcome((9.0,) * 5, tested_on="b"), outcome((9.0,) * 5, commands="held")]
    assert mean_ratio([*four, other, *ignored]) == pytest.approx(0.25)
    assert np.isnan(mean_ratio(ignored))


def test_criteria() -> None:
    good = RealBench([], {}, [], predictions=[outcome()])
    assert [x.verdict for x in criteria(good)][-3:-1] == ["PASS", "PASS"]
    bad = RealBench([], {}, [], predictions=[outcome((1.03,) * 5)])
    assert [x.verdict for x in criteria(bad)][-3:-1] == ["FAIL", "FAIL"]


def test_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def predicted(*arguments: object) -> list[RatioOutcome]:
        return [outcome(), outcome((0.9, 0.9, 0.9, 0.9, 1.5), tested_on="b")]

    monkeypatch.setattr(real_bench, "prediction_outcomes", predicted)
    write_streams(driven("handling", 1, 20.0), tmp_path / "recordings" / "car" / "drive")
    out = tmp_path / "out.jsonl"
    arguments = ["bench", "real", "--recordings", str(tmp_path / "recordings")]
    arguments += ["--part", "predictions"]
    assert main([*arguments, "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "its rest" in text
    assert "1.50" in text
    assert "FAIL  largest ratio" in text
    assert "faults named" not in text
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert [row["mean"][4] for row in rows] == [0.5, 1.5]
    assert main([*arguments, "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["predictions"]) == 2


@pytest.mark.slow
def test_recordings_are_trained_on_and_tested_on(tmp_path: Path) -> None:
    for name, seconds in (("long", 80.0), ("short", 12.0)):
        write_streams(driven("handling", 1, seconds), tmp_path / "car" / name)
    settings = TrainSettings(steps=40, batch=64, quadratic=False, hidden=8, features=4)
    plan = BenchPlan(seeds=1, train=settings)
    result = bench_real(tmp_path, {}, None, (PREDICTIONS,), plan)
    assert {(x.trained_on, x.tested_on) for x in result.predictions} == {
        ("long", "long"),
        ("long", "short"),
    }
    assert {(x.channel, x.commands) for x in result.predictions} == {
        (channel, commands)
        for channel in ("v_x", "v_y", "yaw_rate")
        for commands in ("known", "held")
    }
    assert all(0.0 < ratio < 100.0 for x in result.predictions for ratio in x.mean)
    assert len(result.refused) == 1
    assert "training on short" in result.refused[0]


def test_rows_that_were_trained_on_are_not_tested() -> None:
    """Two published recordings are cut from one drive; a car that stands shares nothing."""

    def record_of(values: FloatArray) -> Record:
        n = len(values)
        zeros = np.zeros(n, dtype=np.int64)
        return Record(
            np.arange(n) * TICK_NS, values[:, :3], values[:, 3:], np.zeros((n, 2)), zeros,
            values[:, :3], zeros,
        )  # fmt: skip

    whole = np.random.default_rng(0).normal(size=(400, 5))
    other = np.random.default_rng(1).normal(size=(300, 5))
    found = shared_rows(record_of(np.concatenate([whole[300:], other])), record_of(whole))
    assert found[:100].all()
    assert not found[100:].any()
    still = record_of(np.zeros((100, 5)))
    assert not shared_rows(still, still).any()
