# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench live: the latency computation, and a short measurement of the real node."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.node import readings, write_model

from adk_ros.bench.runtime.live import bench_live, latencies, live_criteria
from adk_ros.cli.main import main
from adk_ros.errors import DataError
from adk_ros.signals.align import Aligner
from adk_ros.signals.channels import TICK_NS


def test_latency_starts_at_the_input_that_completes_a_tick() -> None:
    sent = list(readings(3.0))
    values = np.full((len(sent), 3), np.nan)
    for row, reading in enumerate(sent):
        values[row, : len(reading.values)] = reading.values
    published_ns = np.arange(len(sent)) * 1_000_000
    aligner = Aligner()
    completing = {
        sample.stamp_ns: int(published_ns[row])
        for row, reading in enumerate(sent)
        for sample in aligner.push(reading)
    }
    ticks = sorted(completing)
    arrived = {tick + TICK_NS: completing[tick] + 2_500_000 for tick in ticks}
    del arrived[ticks[60] + TICK_NS]
    found, missed = latencies(
        np.array([int(reading.source) for reading in sent]),
        np.array([reading.stamp_ns for reading in sent]),
        values, published_ns, arrived, ticks[40],
    )  # fmt: skip
    assert missed == 1
    assert len(found) == len(ticks) - 41
    np.testing.assert_allclose(found, 2.5)


def test_each_target_is_a_criterion() -> None:
    good = {
        "latency_ms": {"p99": 2.0}, "ticks": 2400, "ticks_missed": 0, "tick_p50_ms": 0.3,
        "cpu_percent": 5.9, "relay_cpu_percent": 3.0, "cpu_ratio": 1.97,
        "rates_hz": {"imu": 200.0},
    }  # fmt: skip
    lines = [str(item) for item in live_criteria(good)]
    assert all(line.startswith("PASS ") for line in lines)
    assert "PASS cpu 5.9 % of a core with the IMU at 200 Hz, at most 6" in lines
    assert lines[-1] == (
        "PASS cpu-ratio 1.97 times the load of a node that receives and republishes the same "
        "messages (3 %), at most 2"
    )
    bad = {
        "latency_ms": {"p99": 5.1}, "ticks_missed": 1, "tick_p50_ms": float("nan"),
        "cpu_percent": 6.01, "cpu_ratio": 2.01,
    }  # fmt: skip
    assert all(item.verdict == "FAIL" for item in live_criteria(good | bad))


@pytest.mark.slow
def test_a_short_measurement(tmp_path: Path) -> None:
    calls: list[float] = []
    model = write_model(tmp_path / "model")
    result = bench_live(model, 3.0, progress=lambda done_s, _total_s: calls.append(done_s))
    assert json.loads(json.dumps(result)) == result
    latency = result["latency_ms"]
    # Bounds that hold on a busy machine as well.
    assert 0.0 < latency["p50"] <= latency["p99"] <= latency["max"]
    assert latency["p50"] < 25.0
    assert result["ticks"] == pytest.approx(120, abs=3)
    assert result["ticks_missed"] == 0
    assert 0.0 < result["cpu_percent"] < 60.0
    assert result["node"]["internal_errors"] == 0
    # Each prediction has a horizon, which the node serialises for the listener.
    assert result["horizons"] == pytest.approx(result["ticks"], abs=3)
    verdicts = {item["name"]: item["verdict"] for item in result["criteria"]}
    assert list(verdicts) == ["latency", "ticks-missed", "tick-time", "cpu", "cpu-ratio"]
    assert (verdicts["cpu"] == "PASS") == (result["cpu_percent"] <= 6.0)
    assert 0.0 < result["tick_p50_ms"] < latency["p50"]
    # A Python process that receives 290 messages per second is never idle.
    assert result["relay_cpu_percent"] > 1.0
    ratio = result["cpu_percent"] / result["relay_cpu_percent"]
    assert result["cpu_ratio"] == pytest.approx(ratio, abs=0.01)
    assert calls == sorted(calls)
    assert len(calls) > 10


@pytest.mark.slow
def test_rollouts_through_topics_are_timed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = write_model(tmp_path / "model")
    arguments = ["bench", "rollouts", "--model", str(model), "--requests", "5"]
    assert main([*arguments, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [row["candidates"] for row in result["rows"]] == [1, 100, 1000]
    for row in result["rows"]:
        assert 0.0 < row["in_process"]["p50_ms"] <= row["in_process"]["p99_ms"]
        # To the node and back takes longer than the computation alone.
        assert row["by_topic"]["p50_ms"] > row["in_process"]["p50_ms"]
        assert row["bytes"] == row["candidates"] * 80 * 6 * 8


def test_a_useless_number_of_requests_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "rollouts", "--requests", "2"]) == 2
    assert "--requests 2 is out of range: choose 5 to 10000" in capsys.readouterr().err


@pytest.mark.slow
def test_a_node_that_does_not_start_is_reported(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is not a folder"):
        bench_live(tmp_path / "none", 1.0)
