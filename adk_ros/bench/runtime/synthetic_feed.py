# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An endless drive for benchmarks: a simulated minute, looped with stamps that go on."""

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
_SOURCE = {topic: source for source, (topic, _) in TOPICS.items()}


def simulated_messages(seconds: int = 60, seed: int = 7) -> list[Message]:
    """Messages of a simulated drive in order of arrival: IMU 200 Hz, odometry 50, commands 40."""
    drive = simulate(load_scenario("handling"), seed=seed, duration_s=float(seconds))
    with tempfile.TemporaryDirectory() as folder:
        write_bag(drive, Path(folder) / "bag")
        with Bag(Path(folder) / "bag") as bag:
            return [(_SOURCE[topic], msg) for topic, _, msg in bag.messages()]


def stamp_of(msg: Any) -> int:
    """Header stamp in ns."""
    return int(msg.header.stamp.sec) * 10**9 + int(msg.header.stamp.nanosec)


def endless(messages: list[Message]) -> Iterator[Message]:
    """
    Yield the drive again and again, its stamps moved on by its own length each time.

    The messages' stamps are changed in place, so one feed at a time. The seam is a jump of the
    vehicle's state in one tick: a hard, finite blow that the predictor has to take.
    """
    last = max(stamp_of(msg) for _, msg in messages)
    first = min(stamp_of(msg) for _, msg in messages)
    # A whole number of ticks, the next one after the last message: no stamp comes twice.
    length_ns = ((last - first) // TICK_NS + 1) * TICK_NS
    while True:
        yield from messages
        for _, msg in messages:
            stamp = msg.header.stamp
            stamp.sec, stamp.nanosec = divmod(stamp_of(msg) + length_ns, 10**9)


def bench_model(path: Path | None) -> KoopmanModel:
    """Load `path`, or train a small model for the purpose."""
    if path is not None:
        return artefact.load(path).model
    with tempfile.TemporaryDirectory() as folder:
        write_model(Path(folder) / "model")
        return artefact.load(Path(folder) / "model").model


def write_model(out: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Train a small model (sizes as the default's, few steps) and write its artefact."""
    drive = simulate(load_scenario("town"), duration_s=120.0)
    settings = TrainSettings(steps=200, short_share=1.0, batch=128, validate_every=100)

    def on_step(step: Step) -> None:
        if progress is not None:
            progress(step.step, step.steps)

    run_training([drive.truth()], out, settings, on_step=on_step)
