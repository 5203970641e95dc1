# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The node `watch`: says which physics of the car has changed since it was started.

Publishes each change, and its revisions, as JSON on `~/change` (latched) and its state in
`/diagnostics`; writes the evidence of each change as a bag, with the command that analyses it.
All times are header stamps, so that the node needs no clock.
"""

from __future__ import annotations

import json
import math
import os
import shlex
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from adk_ros.bags import IMU_TYPE
from adk_ros.errors import AdkError, UsageError
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.watch.change import FINAL, Change
from adk_ros.mismatch.watch.stamp_filter import StampFilter
from adk_ros.mismatch.watch.watch import Watch
from adk_ros.ros.diagnostics import Level
from adk_ros.ros.evidence import Evidence, StampedMessage
from adk_ros.ros.messages import split_stamp
from adk_ros.ros.node import Stop
from adk_ros.ros.parameter_file import write_sensor_parameters
from adk_ros.ros.session import Session, message_class
from adk_ros.ros.static_transforms import ImuExtrinsics
from adk_ros.ros.watch_report import WatchInputs, watch_report
from adk_ros.signals.channels import Source
from adk_ros.signals.commands import COMMAND_TYPES
from adk_ros.signals.decode import Decoder, RefusedMessage, SensorConfig
from adk_ros.signals.extrinsics import frame_of
from adk_ros.signals.frames import pose_of
from adk_ros.signals.velocity_messages import ODOMETRY_TYPES

NODE_NAME = "watch"
DIAGNOSTIC_NAME = ": watch"
"""End of the DiagnosticStatus name, after the name of the node."""
MODEL_FILE, EVIDENCE, CHANGE_FILE, REPORT = "watched.yaml", "evidence", "change.json", "report"
PARAMETERS_FILE = "sensors.yaml"
MAX_FOLDERS = 20
"""Most folders with evidence that one run writes: 20 bags of 30 MB. By choice."""
_BEFORE_S = 120.0
"""s of evidence before the onset: the part on which `adk mismatch` learns the car. By choice."""
_DEPTH = 4000
"""Queue depth of the subscriptions, messages: 4 s of an IMU at 1000 Hz; a step takes 0.4 s."""
_SERVICES = 8
"""Calls of the executor per report: each serves a parameter service, or one of four inputs."""
_PERIOD_S = 1.0
"""s between diagnostics."""
_POLL_S = 0.05
"""s between two looks at the subscriptions: a change is named minutes after its onset."""


_Pose = tuple[float, float, float] | None


@dataclass(frozen=True)
class WatchOptions:
    """
    Topics, name and outputs of a watch.

    `out`: folder for the evidence, None: none is written; `run_mismatch`: analyse it at once.
    """

    topics: dict[Source, str]
    sensors: SensorConfig
    namespace: str = ""
    out: Path | None = None
    run_mismatch: bool = False


def source_topics(imu: str, odometry: str, command: str) -> dict[Source, str]:
    """Return the topic of each source."""
    return {Source.IMU: imu, Source.ODOMETRY: odometry, Source.COMMAND: command}


class WatchNode:
    """Subscribes to the inputs of a car and runs its watch; `note` takes a line for the user."""

    def __init__(
        self,
        session: Session,
        surrogate: SurrogateModel,
        options: WatchOptions,
        note: Callable[[str], None],
    ) -> None:
        self._options, self._note = options, note
        self._session, self._node = session, session.node
        self._name = str(self._node.get_fully_qualified_name()).lstrip("/")
        self.watch = Watch(surrogate, self._on_change)
        kind = COMMAND_TYPES[options.sensors.command_type]
        if kind.inferred_torque:
            raise UsageError(
                f"command_type '{options.sensors.command_type}' carries an acceleration: the "
                "watch needs the wheel torque, such as a JointState with effort"
            )
        types = {
            Source.IMU: IMU_TYPE,
            Source.ODOMETRY: ODOMETRY_TYPES[options.sensors.odometry_type].msgtype,
            Source.COMMAND: kind.msgtype,
        }
        self._classes = {s: message_class(t, "the watch") for s, t in types.items()}
        self._decoder = Decoder(options.sensors)
        self.frames: dict[Source, str] = {}
        self.on_frames: Callable[[], None] = _ignore
        self._topics = {s: session.resolve(options.topics[s]) for s in types}
        self._stamps: StampFilter[tuple[StampedMessage, _Pose]] = StampFilter()
        self._reported_strays: Counter[Source] = Counter()
        self._evidence = Evidence({self._topics[s]: t for s, t in types.items()})
        self._received: Counter[Source] = Counter({source: 0 for source in types})
        self._last_s = dict.fromkeys(types, -math.inf)
        self._jobs: list[Iterator[None]] = []
        self._children: list[subprocess.Popen[bytes]] = []
        self._written = 0
        self._reported_s, self._cpu_s = time.monotonic(), time.process_time()
        if options.out is not None:
            options.out.mkdir(parents=True, exist_ok=True)
            (options.out / MODEL_FILE).write_text(simulation_yaml(surrogate), encoding="utf-8")
        latched: Any = QoSProfile
        self._change_out = self._node.create_publisher(
            String,
            "~/change",
            latched(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL),
        )
        self._diagnostics_out = self._node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        qos = latched(
            history=HistoryPolicy.KEEP_LAST,
            depth=_DEPTH,
            reliability=ReliabilityPolicy.BEST_EFFORT,
        )
        self._subscriptions = {
            source: self._node.create_subscription(
                message, self._topics[source], partial(self._take, source), qos, raw=True
            )
            for source, message in self._classes.items()
        }
        self._extrinsics = ImuExtrinsics(self._node, self, note)

    @property
    def sensors(self) -> SensorConfig:
        """The configuration that messages are read with."""
        return self._decoder.config

    def set_sensors(self, sensors: SensorConfig) -> None:
        """Read all further messages with another configuration; learn the car anew."""
        refused = self._decoder.refused
        self._decoder = Decoder(sensors)
        self._decoder.refused = refused
        self.watch.restart()

    def guarded(self) -> AbstractContextManager[None]:
        """Return a context that ignores a message of which a part is missing."""
        return suppress(AdkError, AttributeError, TypeError, ValueError)

    def receive(self) -> None:
        """Take all messages that have arrived, in the order of their arrival."""
        if self._extrinsics.subscription is not None:
            for _, message in Session.received(self._extrinsics.subscription):
                self._extrinsics.take(message)
        arrived = [
            (at_ns, source, content)
            for source, subscription in self._subscriptions.items()
            for at_ns, content in Session.received(subscription)
        ]
        for _, source, content in sorted(arrived, key=lambda x: x[0]):
            self._take(source, content)

    def _take(self, source: Source, content: bytes) -> None:
        """Store a message and its reading."""
        self._received[source] += 1
        self._last_s[source] = time.monotonic()
        message = deserialize_message(content, self._classes[source])
        try:
            reading = self._decoder.decode(source, message)
        except RefusedMessage:
            return
        if source not in self.frames and source <= Source.ODOMETRY:
            self.frames[source] = frame_of(message)
            self.on_frames()
        pose = None
        if source is Source.ODOMETRY:
            pose = pose_of(message, self.sensors.odometry_rotation)
        stamped = StampedMessage(self._topics[source], reading.stamp_ns, bytes(content))
        is_new_time, admitted = self._stamps.admit(reading, (stamped, pose))
        if is_new_time:
            self.watch.restart()
            self._evidence.clear()
        for taken, (its_message, its_pose) in admitted:
            self.watch.push(taken, its_pose)
            if self._options.out is not None:
                self._evidence.add(its_message)

    def work(self) -> bool:
        """Do one piece of work, and report if it is time; return whether there was any work."""
        busy = self.watch.step() or bool(self._jobs)
        if self._jobs:
            try:
                next(self._jobs[0])
            except StopIteration:
                self._jobs.pop(0)
            except AdkError as error:
                self._jobs.pop(0)
                self._note(f"no evidence is written: {error}")
        self._children = [child for child in self._children if child.poll() is None]
        now_s = time.monotonic()
        if now_s - self._reported_s >= _PERIOD_S:
            for _ in range(_SERVICES):
                self._session.spin(0.0)
            self._report(now_s)
        return busy

    def received_text(self) -> str:
        """Return how many messages of each source have come."""
        counts = [f"{times} {source.name.lower()}" for source, times in self._received.items()]
        return f"received messages: {', '.join(counts)}"

    def _on_change(self, change: Change) -> None:
        text = json.dumps({"node": self._name, **change.as_dict()})
        self._change_out.publish(String(data=text))
        self._note(f"change {change.number}, {change.state}: {change.sentence()}")
        if change.state == FINAL and self._options.out is not None:
            if self._written >= MAX_FOLDERS:
                self._note(f"{MAX_FOLDERS} folders of evidence are written: no further ones")
                return
            self._written += 1
            self._jobs.append(self._save(change, text, self._options.out))

    def _save(self, change: Change, text: str, out: Path) -> Iterator[None]:
        """Write the evidence of a change; then state, or run, the command that analyses it."""
        folder = _new_name(out, change.number)
        begin_ns = change.stamp_ns(change.onset_s - _BEFORE_S)
        # Under a hidden name until it is whole: the process may end at any time.
        partial_folder = out / f".{folder.name}.part"
        shutil.rmtree(partial_folder, ignore_errors=True)
        partial_folder.mkdir()
        yield from self._evidence.write(
            partial_folder / EVIDENCE, begin_ns, change.stamp_ns(change.until_s)
        )
        (partial_folder / CHANGE_FILE).write_text(text + "\n", encoding="utf-8")
        # The evidence is to be read as the watch read it, with the pose of the IMU.
        write_sensor_parameters(partial_folder / PARAMETERS_FILE, self.sensors)
        partial_folder.rename(folder)
        command = ["mismatch", "--simulation", str(out / MODEL_FILE)]
        command += ["--recording", str(folder / EVIDENCE)]
        command += ["--params", str(folder / PARAMETERS_FILE), "--out", str(folder / REPORT)]
        self._note(f"analyse the evidence: {shlex.join(['adk', *command])}")
        if self._options.run_mismatch:
            if self._children:
                self._note("an analysis is still running: this one is not started")
                return
            log = (folder / "mismatch.log").open("wb")
            with log:
                self._children.append(
                    subprocess.Popen(
                        ["nice", sys.executable, "-m", "adk_ros.cli.main", *command],
                        stdout=log,
                        stderr=subprocess.STDOUT,
                        stdin=subprocess.DEVNULL,
                        start_new_session=True,
                        env={**os.environ, "OMP_NUM_THREADS": "1"},
                    )
                )

    def _report(self, now_s: float) -> None:
        cpu_s = time.process_time()
        share = (cpu_s - self._cpu_s) / (now_s - self._reported_s)
        self._reported_s, self._cpu_s = now_s, cpu_s
        refused: Counter[str] = Counter()
        for (source, reason), times in self._decoder.refused.items():
            refused[f"{source.name.lower()}: {reason}"] += times
        strays = self._stamps.strays.copy()
        inputs = WatchInputs(
            {source.name.lower(): times for source, times in self._received.items()},
            {source.name.lower(): now_s - at_s for source, at_s in self._last_s.items()},
            refused,
            {source.name.lower(): times for source, times in strays.items()},
            [source.name.lower() for source in sorted(strays - self._reported_strays)],
        )
        self._reported_strays = strays
        level, text, values = watch_report(self.watch, inputs, share)
        message = DiagnosticArray()
        now_ns = self._node.get_clock().now().nanoseconds
        message.header.stamp.sec, message.header.stamp.nanosec = split_stamp(now_ns)
        message.status = [
            DiagnosticStatus(
                level=bytes([Level(level)]),
                name=self._name + DIAGNOSTIC_NAME,
                message=text,
                hardware_id=self._name,
                values=[KeyValue(key=key, value=value) for key, value in values],
            )
        ]
        self._diagnostics_out.publish(message)


def _ignore() -> None:
    """Do nothing."""


def _new_name(out: Path, number: int) -> Path:
    """Return the folder of a change; an earlier run may have used its number."""
    first = out / f"change_{number}"
    others = (out / f"change_{number}_{i}" for i in count(2))
    return next(x for x in chain([first], others) if not x.exists())


def watch(
    surrogate: SurrogateModel,
    options: WatchOptions,
    note: Callable[[str], None],
    duration_s: float | None = None,
) -> bool:
    """
    Run the node until SIGINT or SIGTERM, or for `duration_s`; return whether a signal ended it.

    :raises UsageError: a topic or message type does not fit.
    """
    stop = Stop()
    try:
        with Session(NODE_NAME, options.namespace, polled=True) as session:
            node = WatchNode(session, surrogate, options, note)
            end_s = math.inf if duration_s is None else time.monotonic() + duration_s
            stop.starting = False
            while not stop.requested and time.monotonic() < end_s:
                node.receive()
                if not node.work():
                    time.sleep(_POLL_S)
            note(node.received_text())
            return stop.requested
    finally:
        stop.close()
