# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""CPU load of the whole process `adk watch` on a drive that is played in real time."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import psutil  # type: ignore[import-untyped, unused-ignore]

from adk_ros.api.simulate import simulate
from adk_ros.bench.runtime.ros_processes import (
    cpu_seconds,
    end_process,
    last_error,
    start_process,
)
from adk_ros.errors import DataError, UsageError
from adk_ros.mismatch.deployment.simulator_input import sensor_log_of
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.recording.nominal_vehicle import nominal_vehicle_of
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.offline.export import TOPICS
from adk_ros.signals.channels import Source

TARGET_PERCENT = 10.0
"""Required load, per cent of a core."""
MAX_LIVE_S = 3600.0
_SCENARIO = "handling"
_START_S, LEARN_S = 10.0, 140.0
"""s for the processes to find each other, and s before the measurement: the watch learns the car
for 130 s (`watch.settings`), after which it looks for changes."""
_MIN_RATE_HZ = 20.0
"""Least messages of each input per second: all that are played have twice as many."""
_MODULE = "adk_ros.cli.main"

Progress = Callable[[float, float], None]
Processes = tuple[subprocess.Popen[str], subprocess.Popen[str]]


def check_live(duration_s: float) -> None:
    """
    Check the option and the installation, without doing any work.

    :raises UsageError: a value out of range, or ROS 2 is not installed.
    """
    if not 0.0 <= duration_s <= MAX_LIVE_S:
        raise UsageError(f"--live is {duration_s:g}: choose 0 to {MAX_LIVE_S:g} s")
    if duration_s and importlib.util.find_spec("rclpy") is None:
        raise UsageError(
            "--live plays a drive on ROS topics, and rclpy is not installed:"
            " run `make install`, or source your ROS 2 installation"
        )


def watch_load(
    duration_s: float, progress: Progress | None = None, learn_s: float = LEARN_S
) -> float:
    """
    Return the load of the watch over `duration_s`, receiving and computing, per cent of a core.

    It watches a recording without a change, with the surrogate of that recording, from `learn_s`
    after its start.

    :raises DataError: a process ended early.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="adk_watch_")))
        seconds = _START_S + learn_s + duration_s
        drive = simulate(_SCENARIO, folder / "bag", duration_s=seconds).drive
        log = sensor_log_of(drive)
        surrogate, _ = surrogate_of(
            log, log, nominal_vehicle_of(drive.vehicle), lambda done, stage: None
        )
        model = folder / "simulation.yaml"
        model.write_text(simulation_yaml(surrogate), encoding="utf-8")
        topics = [x for source, (name, _) in TOPICS.items() for x in (_option(source), name)]
        watch = start_process(stack, folder, _MODULE, "watch", "--model", str(model), *topics)
        player = start_process(stack, folder, _MODULE, "play", str(folder / "bag"))
        _wait(_START_S + learn_s, (watch, player), folder)
        process = psutil.Process(watch.pid)
        begin_s, spent_s = time.monotonic(), cpu_seconds(process)
        while (done_s := time.monotonic() - begin_s) < duration_s:
            _check((watch, player), folder)
            if progress is not None:
                progress(done_s, duration_s)
            time.sleep(0.1)
        percent = 100.0 * (cpu_seconds(process) - spent_s) / (time.monotonic() - begin_s)
        end_process(player)
        end_process(watch)
        received = last_error(folder, "watch")
        counts = [int(x) for x in re.findall(r"(\d+) [a-z]+", received)]
        if len(counts) != len(TOPICS) or min(counts) < _MIN_RATE_HZ * (learn_s + duration_s):
            raise DataError(f"the watch missed its inputs: {received}")
        return percent


def _wait(seconds: float, processes: Processes, folder: Path) -> None:
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        _check(processes, folder)
        time.sleep(0.5)


def _check(processes: Processes, folder: Path) -> None:
    watch, player = processes
    if watch.poll() is not None:
        raise DataError(f"the watch ended: {last_error(folder, 'watch')}")
    if player.poll():
        raise DataError(f"the player failed: {last_error(folder, 'play')}")


def _option(source: Source) -> str:
    return f"--{source.name.lower()}"


def load_line(percent: float) -> str:
    """Return the load with its target."""
    verdict = "PASS" if percent <= TARGET_PERCENT else "FAIL"
    return (
        f"{verdict} receiving and computing, in real time: {percent:.1f} % of a core "
        f"(at most {TARGET_PERCENT:g} %)"
    )
