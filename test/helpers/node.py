# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Helpers for node tests: a model, a bag, a rig without ROS topics, the node as a process."""

import io
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from adk_ros.bags import BagWriter
from adk_ros.bags import message as bag_message
from adk_ros.model import artefact
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder import Lifting, input_size
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.pipeline import Pipeline, PipelineSettings
from adk_ros.model.prediction import Prediction
from adk_ros.model.training_range import TrainingRange
from adk_ros.ros.core import Core
from adk_ros.ros.diagnostic_values import Clocks
from adk_ros.ros.diagnostics import DiagnosticReport, Diagnostics
from adk_ros.ros.session import Session
from adk_ros.ros.traffic import Rates, message, motion, schedule
from adk_ros.signals.channels import TICK_NS, Reading, Source

TOPICS = {
    "/imu/data": Source.IMU,
    "/odometry": Source.ODOMETRY,
    "/vehicle/command": Source.COMMAND,
}
REMAP = {"/imu/data": "imu", "/odometry": "odometry", "/vehicle/command": "command"}
START_NS = 1_760_000_000_012_345_678


class Perceptron(torch.nn.Module):
    """An encoder whose architecture has a compiled counterpart, with random weights."""

    def __init__(self, n_in: int, hidden: int, n_out: int) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(0)

        def random_parameter(*shape: int) -> torch.nn.Parameter:
            return torch.nn.Parameter(torch.randn(*shape, generator=generator) * 0.2)

        self.w1, self.b1 = random_parameter(n_in, hidden), random_parameter(hidden)
        self.w2, self.b2 = random_parameter(hidden, hidden), random_parameter(hidden)
        self.w3, self.b3 = random_parameter(hidden, n_out), random_parameter(n_out)
        self.skip = random_parameter(n_in, n_out)

    def forward(self, row: torch.Tensor) -> torch.Tensor:
        first = torch.tanh(torch.addmm(self.b1, row, self.w1))
        second = torch.tanh(torch.addmm(self.b2, first, self.w2))
        return torch.addmm(self.b3, second, self.w3) + row @ self.skip


def write_model(
    folder: Path, uses_imu: bool = True, trained_on: TrainingRange | None = None
) -> Path:
    """Write a model with random weights that is stable and complete."""
    history, n_features = 4, 6
    n_in = input_size(history)
    buffer = io.BytesIO()
    torch.jit.save(torch.jit.script(Perceptron(n_in, 16, n_features)), buffer)
    rng = np.random.default_rng(0)
    theta = rng.normal(0.0, 0.01, (3 + n_features, 3 + n_features + 3))
    theta[:3, :3] -= 0.02 * np.eye(3)
    model = KoopmanModel(
        lifting=Lifting(buffer.getvalue(), n_in, n_features),
        scaling=Scaling(
            np.array([15.0, 0.0, 0.0]), np.array([6.0, 0.2, 0.2]), np.array([100.0, 0.0]),
            np.array([500.0, 0.05]), np.array([0.01, 0.05, 0.05]),
        ),
        theta0=theta, history=history, residual=True, affine=True, relift=True,
        observer_gains=ObserverGains(
            np.ones(3), np.full(3, 0.05), np.full(3, 0.97), np.full(3, 0.5), np.full(3, 0.8)
        ),
        mean_square_change=np.outer(np.arange(1.0, 81.0), [0.02, 0.01, 0.001]),
        horizon_covariance=np.stack([np.diag([0.01, 0.01, 0.001]) * (j + 1) for j in range(80)]),
        uses_imu=uses_imu,
    )  # fmt: skip
    facts = {} if trained_on is None else {"range": trained_on.as_json()}
    artefact.save(folder, buffer.getvalue(), model, {"note": "random"} | facts)
    return folder


def readings(
    duration_s: float, rates: Rates | None = None, start_ns: int = START_NS, seed: int = 0
) -> Iterator[Reading]:
    """Yield the readings of a slalom, in order of time."""
    noise = random.Random(seed)
    for due in schedule(rates or Rates(), duration_s):
        time_s = due.offset_ns * 1e-9
        yield Reading(due.source, start_ns + due.offset_ns, motion(due.source, time_s, noise))


def write_bag(path: Path, duration_s: float = 10.0, rates: Rates | None = None) -> Path:
    """Write the readings of a slalom as a bag, logged 2 ms after each stamp."""
    kinds = {
        "/imu/data": "sensor_msgs/msg/Imu",
        "/odometry": "nav_msgs/msg/Odometry",
        "/vehicle/command": "sensor_msgs/msg/JointState",
    }
    names = {source: topic for topic, source in TOPICS.items()}
    with BagWriter(path) as writer:
        for topic, kind in kinds.items():
            writer.add_topic(topic, kind)
        for reading in readings(duration_s, rates):
            topic = names[reading.source]
            values = reading.values
            header = {"stamp": reading.stamp_ns}
            if reading.source is Source.IMU:
                fields: dict[str, Any] = {
                    "linear_acceleration": {"x": values[0], "y": values[1], "z": 9.81},
                    "angular_velocity": {"z": values[2]},
                }
            elif reading.source is Source.ODOMETRY:
                twist = {"linear": {"x": values[0], "y": values[1]}, "angular": {"z": values[2]}}
                fields = {"twist": {"twist": twist}}
            else:
                fields = {
                    "name": ["drive", "steer"],
                    "effort": [values[0], 0.0],
                    "position": [0.0, values[1]],
                }
            msg = bag_message(kinds[topic], header=header, **fields)
            writer.write(topic, msg, reading.stamp_ns + 2_000_000)
    return path


Change = Callable[[Source, Any], Any]
"""Maps a message to itself, another message, a list of messages, or None (lost)."""


@dataclass
class Rig:
    """Node core and diagnostics in simulated time: seconds of driving take milliseconds."""

    model: KoopmanModel
    settings: PipelineSettings = field(default_factory=PipelineSettings)
    use_imu: str = "auto"
    rates: Rates = field(default_factory=Rates)

    def __post_init__(self) -> None:
        self.mono_ns = 50_000_000_000
        self.stamp_offset_ns = START_NS - self.mono_ns
        self.published: list[Prediction] = []
        self.errors: list[Exception] = []
        self.reports: list[DiagnosticReport] = []
        self.pipeline = Pipeline(self.model, self.settings)
        self.core = Core(
            self.pipeline, self.published.append, self.errors.append, lambda: self.mono_ns
        )
        self.diagnostics = Diagnostics(
            self.core, {"model": "test"}, self.use_imu, self.mono_ns * 1e-9
        )
        self.sim_time: tuple[bool, bool] = (False, True)
        self.noise = random.Random(0)

    @property
    def stamp_ns(self) -> int:
        return self.mono_ns + self.stamp_offset_ns

    def drive(
        self, duration_s: float, change: Change | None = None, watch: bool = True
    ) -> list[DiagnosticReport]:
        """Drive for `duration_s`; return the reports, one per second."""
        begin_ns = self.mono_ns
        earlier = len(self.reports)
        events: list[tuple[int, int, Source | None]] = [
            (due.offset_ns, 0, due.source) for due in schedule(self.rates, duration_s)
        ]
        end_ns = round(duration_s * 1e9)
        if watch:
            events += [(offset, 1, None) for offset in range(TICK_NS, end_ns + 1, TICK_NS)]
        events += [(offset, 2, None) for offset in range(10**9, end_ns + 1, 10**9)]
        for offset_ns, kind, source in sorted(events, key=lambda event: event[:2]):
            self.mono_ns = begin_ns + offset_ns
            if kind == 2:
                self.report()
            elif kind == 1:
                self.core.on_timer(self.stamp_ns)
            else:
                assert source is not None
                self._deliver(source, change)
        self.mono_ns = begin_ns + end_ns
        return self.reports[earlier:]

    def _deliver(self, source: Source, change: Change | None) -> None:
        time_s = (self.mono_ns - 50_000_000_000) * 1e-9
        reading = Reading(source, self.stamp_ns, motion(source, time_s, self.noise))
        original = message(reading)
        changed = original if change is None else change(source, original)
        for msg in changed if isinstance(changed, list) else [changed]:
            if msg is not None:
                self.core.on_message(source, msg)

    def report(self) -> DiagnosticReport:
        """Append a report and return it."""
        wanted, running = self.sim_time
        ros_ns = self.stamp_ns if running else 0
        self.reports.append(self.diagnostics.report(Clocks(self.mono_ns * 1e-9, ros_ns, wanted)))
        return self.reports[-1]

    def all_finite(self) -> bool:
        return all(
            np.isfinite(p.x).all()
            and np.isfinite(p.covariance).all()
            and np.isfinite(p.horizon).all()
            for p in self.published
        )


def run_python(code: str, *arguments: str) -> subprocess.Popen[str]:
    """Start Python code in a separate process."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


class NodeProcess:
    """The node's executable, started with the given parameters."""

    def __init__(self, *arguments: str, **parameters: Any) -> None:
        given = [f"-p{name}:={value}" for name, value in parameters.items()]
        split = [part for item in given for part in ("-p", item[2:])]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "adk_ros.ros.node", "--ros-args", *split, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def end(self, number: int = signal.SIGINT) -> tuple[int, float]:
        """Send a signal; return the exit code and the seconds until the end."""
        begin_s = time.monotonic()
        self.process.send_signal(number)
        code = self.process.wait(10.0)
        return code, time.monotonic() - begin_s


@contextmanager
def running_node(*arguments: str, **parameters: Any) -> Iterator[NodeProcess]:
    """Run a node process; it is killed at the end in any case."""
    node = NodeProcess(*arguments, **parameters)
    try:
        yield node
    finally:
        if node.process.poll() is None:
            node.process.kill()
        node.process.communicate()


def call(session: Session, kind: Any, name: str, request: Any) -> Any:
    """Call a service of a running node once it is there, and return the response."""
    client = session.node.create_client(kind, name)
    # A node that has been changed compiles before it offers a service, or answers: a minute on a
    # slow machine.
    wait_for(session, client.service_is_ready, limit_s=120.0)
    future = client.call_async(request)
    wait_for(session, future.done, limit_s=120.0)
    return future.result()


def wait_for(session: Session, condition: Callable[[], bool], limit_s: float = 20.0) -> None:
    """Handle messages until `condition` is true."""
    deadline_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline_s
        session.spin(0.05)


def environment() -> dict[str, str]:
    """Return the environment for child processes."""
    return dict(os.environ)
