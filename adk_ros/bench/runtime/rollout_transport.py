# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What rollouts of candidate commands cost through the node's topics, compared with in-process calls.

Sensors, node and planner are processes of their own on this machine. The round trip runs from the
planner's array of commands to its array of states.
"""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bench.runtime.live import MODULE, await_line
from adk_ros.bench.runtime.rollout_latency import STEPS
from adk_ros.bench.runtime.ros_processes import last_error, start_process
from adk_ros.bench.runtime.synthetic_feed import simulated_messages
from adk_ros.errors import DataError, UsageError
from adk_ros.model import artefact
from adk_ros.model.pipeline import Pipeline
from adk_ros.numerics.arrays import FloatArray

CANDIDATES = (1, 100, 1000)
MIN_REQUESTS, MAX_REQUESTS = 5, 10_000
PAUSE_S = 0.1
"""Between an answer and the next request, as of a planner at 10 Hz."""
_IMU_HZ, _ODOMETRY_HZ, _COMMAND_HZ = 200.0, 50.0, 40.0
_TIMEOUT_S = 60.0


def check_requests(requests: int) -> None:
    """:raises UsageError: the number is out of range, or ROS 2 is not installed."""
    from importlib.util import find_spec

    if not MIN_REQUESTS <= requests <= MAX_REQUESTS:
        raise UsageError(
            f"--requests {requests} is out of range: choose {MIN_REQUESTS} to {MAX_REQUESTS}"
        )
    if find_spec("rclpy") is None:
        raise UsageError(
            "adk bench rollouts runs the ROS 2 node, and rclpy is not installed:"
            " run `make install`, or source your ROS 2 installation"
        )


def bench_rollout_transport(
    model: Path | str, requests: int, progress: Callable[[float, float], None] | None = None
) -> dict[str, Any]:
    """
    Return {"steps", "rows"}, a row for each number of candidates, for JSON.

    A row has `candidates`, `bytes` to and fro, and p50 and p99 in ms of `by_topic` (round trip)
    and `in_process` (`Predictor.roll_out_many` with the same commands and pauses).
    :raises UsageError: as `check_requests`.
    :raises DataError: the node did not start, or a part of the measurement failed.
    """
    check_requests(requests)
    report = progress or (lambda done, total: None)
    duration_s = _TIMEOUT_S + len(CANDIDATES) * requests * (PAUSE_S + 0.2)
    rates = [str(value) for value in (duration_s, _IMU_HZ, _ODOMETRY_HZ, _COMMAND_HZ)]
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="adk_bench_")))
        node = start_process(
            stack, folder, "adk_ros.ros.node", "--ros-args", "-p", f"model:={model}"
        )
        sent = str(folder / "sent.npz")
        traffic = start_process(stack, folder, MODULE, "drive", sent, "1", *rates)
        await_line(traffic, "started", node, folder)
        own = "adk_ros.bench.runtime.rollout_transport"
        planner = start_process(stack, folder, own, "request", str(requests), str(model))
        times = [
            _row(planner, node, folder, partial(report, k, len(CANDIDATES)))
            for k in range(len(CANDIDATES))
        ]
    local = _in_process(model, requests)
    rows = []
    for count, spent, own_ms in zip(CANDIDATES, times, local, strict=True):
        values = count * STEPS * 8
        row = {"candidates": count, "bytes": values * 2 + values * 4}
        rows.append(row | {"by_topic": _percentiles(spent), "in_process": _percentiles(own_ms)})
    return {"steps": STEPS, "rows": rows}


def _percentiles(times_ms: FloatArray) -> dict[str, float]:
    p50, p99 = np.percentile(times_ms, (50, 99)).round(3).tolist()
    return {"p50_ms": p50, "p99_ms": p99}


def _row(
    planner: subprocess.Popen[str],
    node: subprocess.Popen[str],
    folder: Path,
    begin: Callable[[], None],
) -> FloatArray:
    """Return the next line of the planner: its round trips, ms."""
    begin()
    assert planner.stdout is not None
    line = planner.stdout.readline()
    if not line or node.poll() is not None:
        raise DataError(f"the measurement failed: {last_error(folder)}")
    return np.array(json.loads(line))


def _commands(scale: FloatArray, mean: FloatArray, count: int) -> FloatArray:
    noise = np.random.default_rng(count).normal(size=(count, STEPS, 2))
    return np.asarray(mean + 0.5 * scale * noise)


def _in_process(model: Path | str, requests: int) -> list[FloatArray]:
    pipeline = Pipeline(artefact.load(Path(model)).model)
    for source, message in simulated_messages(seconds=5):
        pipeline.take(source, message)
    predictor = pipeline.predictor
    scaling = predictor.model.scaling
    out = []
    for count in CANDIDATES:
        commands = _commands(scaling.u_scale, scaling.u_mean, count)
        predictor.roll_out_many(commands)
        spent = []
        for _ in range(requests):
            time.sleep(PAUSE_S)
            begin = time.perf_counter()
            predictor.roll_out_many(commands)
            spent.append(1e3 * (time.perf_counter() - begin))
        out.append(np.array(spent))
    return out


def _request(requests: str, model: str) -> None:
    """Ask a running node, and print a line of round trips, ms, for each number of candidates."""
    from adk_ros.ros.rollout_client import RolloutClient
    from adk_ros.ros.session import Session

    scaling = artefact.load(Path(model)).model.scaling
    with Session("planner") as session:
        client = RolloutClient(session)
        for count in CANDIDATES:
            commands = _commands(scaling.u_scale, scaling.u_mean, count)
            spent = client.times_ms(commands, int(requests), PAUSE_S, _TIMEOUT_S)
            print(json.dumps(spent.tolist()), flush=True)


if __name__ == "__main__":
    # Garbage collection in the measuring process must not count as the node's time.
    gc.disable()
    parts: dict[str, Callable[..., None]] = {"request": _request}
    parts[sys.argv[1]](*sys.argv[2:])
