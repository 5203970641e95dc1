# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Endless message feed for benchmarks: one simulated minute, looped with advancing stamps."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from adk_ros.bags import Bag
from adk_ros.model import artefact
from adk_ros.model.koopman import KoopmanModel
from adk_ros.offline.export import TOPICS, write_bag
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.signals.channels import TICK_NS, Source
from adk_ros.train.network_fit import Step
from adk_ros.train.train_settings import TrainSettings
from adk_ros.train.training_run import run_training

Message = tuple[Source, Any]
_TRAINING_SEED = 9000
_SOURCE = {topic: source for source, (topic, _) in TOPICS.items()}


def simulated_messages(seconds: int = 60, seed: int = 7) -> list[Message]:
    """Simulate a drive; messages in order of arrival: IMU 200, odometry 50, command 40 Hz."""
    drive = simulate(load_scenario("handling"), seed=seed, duration_s=float(seconds))
    with tempfile.TemporaryDirectory() as folder:
        write_bag(drive, Path(folder) / "bag")
        with Bag(Path(folder) / "bag") as bag:
            return [(_SOURCE[topic], msg) for topic, _, msg in bag.messages()]


def stamp_of(msg: Any) -> int:
    """Return the header stamp, ns."""
    return int(msg.header.stamp.sec) * 10**9 + int(msg.header.stamp.nanosec)


def endless(messages: list[Message]) -> Iterator[Message]:
    """
    Repeat the messages without end, with stamps that advance by the drive's length each time.

    Stamps change in place, so only one feed may use `messages` at a time. Between repetitions the
    vehicle state jumps within one tick: a large, finite disturbance for the predictor.
    """
    last = max(stamp_of(msg) for _, msg in messages)
    first = min(stamp_of(msg) for _, msg in messages)
    # A whole number of ticks, past the last message: no stamp occurs twice.
    length_ns = ((last - first) // TICK_NS + 1) * TICK_NS
    while True:
        yield from messages
        for _, msg in messages:
            stamp = msg.header.stamp
            stamp.sec, stamp.nanosec = divmod(stamp_of(msg) + length_ns, 10**9)


def bench_model(path: Path | None) -> KoopmanModel:
    """Load `path`, or train a small temporary model."""
    if path is not None:
        return artefact.load(path).model
    with tempfile.TemporaryDirectory() as folder:
        write_model(Path(folder) / "model")
        return artefact.load(Path(folder) / "model").model


def write_model(out: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Train a model of the default size for few steps and write its folder `out`."""
    # Of a seed that no benchmark tests with.
    drive = simulate(load_scenario("town"), seed=_TRAINING_SEED, duration_s=120.0)
    settings = TrainSettings(steps=200, short_share=1.0, batch=128, validate_every=100)

    def on_step(step: Step) -> None:
        if progress is not None:
            progress(step.step, step.steps)

    run_training([drive.truth()], out, settings, on_step=on_step)
