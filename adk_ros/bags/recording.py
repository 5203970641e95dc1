# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Read a bag: choose its topics, decode their messages, align the readings to a record.

A `Reading` is one decoded message, a `Record` (`signals.channels`) the readings aligned to the
25 ms grid, a `Recording` the record of a bag with its topics, warnings and commands.

Replay, training and mismatch analysis share `messages_of` and `RecordingReader`, so that all of
them use the same topics and refuse the same messages.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from adk_ros.bags import Bag, Topics, find_topics
from adk_ros.bags.axle_speed import AxleSpeed
from adk_ros.errors import DataError
from adk_ros.signals.absent_command import NO_COMMAND_WARNING, absent_command
from adk_ros.signals.channels import Reading, Record, Source
from adk_ros.signals.command_plan import plan_types
from adk_ros.signals.decode import Decoder, RefusedMessage, SensorConfig
from adk_ros.signals.extrinsics import (
    MSGTYPE,
    TOPIC,
    StaticTransforms,
    extrinsics_text,
    frame_of,
    wants_extrinsics,
    with_extrinsics,
)
from adk_ros.signals.message_checks import message_warnings
from adk_ros.signals.plausibility import Plausibility
from adk_ros.signals.record import build_record

Progress = Callable[[int, int], None]
"""Called with (messages done, messages in all)."""

_PROGRESS_INTERVAL = 2000
"""Messages between two calls of a `Progress`: about ten per second when reading a bag."""

_CHECK_INTERVAL = 50
"""Messages of a stream of which one is checked for its frames and covariances: one per second of
odometry at 50 Hz."""


class MessageObserver(Protocol):
    """Sees the messages of a bag as they are read, so that it is read once for several uses."""

    @property
    def topics(self) -> Collection[str]:
        """Names of further topics to read."""

    def add(self, topic: str, log_ns: int, msg: Any) -> None:
        """Take a message, logged at `log_ns`; it must not be changed."""


@dataclass(frozen=True)
class RecordingOptions:
    """
    Topic names and the sensor configuration of the vehicle.

    A name of None is chosen by message type; an empty `imu` or `command` is not read. `wheels`:
    topics of the further wheels of an axle, where `odometry` is that of one wheel.
    """

    imu: str | None = None
    odometry: str | None = None
    command: str | None = None
    use_imu: bool = True
    sensors: SensorConfig = field(default_factory=SensorConfig)
    steering: str | None = None
    wheels: tuple[str, ...] = ()


@dataclass
class Recording:
    """
    A bag's record, with the warnings that arose while it was read.

    `start_ns`: log time of the bag's first message. `sensors`: the configuration that its
    messages were decoded with. `commands`: the command readings at their
    own rate; the record holds only the command in force at each tick. `extrinsics`: the pose of
    the IMU, in a line, if the bag gave it in `/tf_static`.
    """

    record: Record
    topics: Topics
    warnings: list[str]
    start_ns: int
    commands: list[Reading]
    sensors: SensorConfig
    extrinsics: str = ""


def choose_topics(bag: Bag, options: RecordingOptions) -> Topics:
    """
    Return the topics of `bag` to read: those named in `options`, else chosen by message type.

    :raises UsageError, DataError: as `bags.find_topics`.
    """
    sensors = options.sensors
    return find_topics(
        bag,
        options.imu if options.use_imu else "",
        options.odometry,
        options.command,
        sensors.command_type,
        options.steering,
        sensors.odometry_type,
        sensors.steer_joint,
        sensors.wheel_joints if sensors.odometry_type == "wheel_joints" else (),
        options.wheels,
    )


def source_by_topic(topics: Topics) -> dict[str, Source]:
    """Return the source of the readings of each topic, by topic name."""
    sources = {topics.odometry: Source.ODOMETRY}
    if topics.command is not None:
        sources[topics.command] = Source.COMMAND
    if topics.imu is not None:
        sources[topics.imu] = Source.IMU
    if topics.steering is not None:
        sources[topics.steering] = Source.STEERING
    return sources


def selected_messages(
    bag: Bag, topics: Topics, progress: Progress | None = None
) -> Iterator[tuple[Source, int, Any]]:
    """Yield (source, log time in ns, message) of the chosen topics, in log order."""
    source_of = source_by_topic(topics)
    for topic, log_ns, msg in messages_of(bag, topics, progress=progress):
        yield source_of[topic], log_ns, msg


def messages_of(
    bag: Bag,
    topics: Topics,
    further: Collection[str] = (),
    progress: Progress | None = None,
) -> Iterator[tuple[str, int, Any]]:
    """
    Yield (topic, log time in ns, message) of the chosen and further topics, in log order.

    Where `topics` has wheels, the messages of odometry are those of their axle (`AxleSpeed`).
    """
    names = {*source_by_topic(topics), *topics.wheels, *further}
    wheels = (topics.odometry, *topics.wheels)
    axle = AxleSpeed(wheels) if topics.wheels else None
    total = sum(info.count for info in bag.topics if info.name in names)
    for done, (topic, log_ns, msg) in enumerate(bag.messages(names), start=1):
        if progress is not None and (done % _PROGRESS_INTERVAL == 0 or done == total):
            progress(done, total)
        if axle is None or topic not in wheels:
            yield topic, log_ns, msg
        elif (joined := axle.add(topic, log_ns, msg)) is not None:
            yield topics.odometry, log_ns, joined


def plan_topic(bag: Bag, command_type: str) -> str | None:
    """Return the topic of planned commands: named `planned_command`, of a type of plans."""
    kinds = plan_types(command_type)
    named = [x for x in bag.topics if x.name.rsplit("/", 1)[-1] == "planned_command"]
    return next((x.name for x in named if x.msgtype in kinds), None)


class RecordingReader:
    """
    One pass over the decoded readings of an open bag.

    `topics` are the chosen topics, `sensors` the configuration with the pose of the IMU, if the
    bag has it in `/tf_static`; `extrinsics` says so in a line, else it is empty. Messages that
    the decoder refuses are skipped and counted; `refusals()` and `warnings()` are complete once
    the pass is.

    :param observer: sees the messages of `topics` and of its own, also those that are refused.
    :raises UsageError, DataError: as `choose_topics`.
    """

    def __init__(
        self,
        bag: Bag,
        options: RecordingOptions,
        progress: Progress | None = None,
        observer: MessageObserver | None = None,
    ) -> None:
        self.topics = choose_topics(bag, options)
        self._bag = bag
        self._tf_warnings: list[str] = []
        self.sensors = self._with_extrinsics(options.sensors)
        known = self.sensors != options.sensors
        self.extrinsics = f"{bag.path.name}: {extrinsics_text(self.sensors)}" if known else ""
        self._decoder = Decoder(self.sensors)
        self._progress = progress
        self._observer = observer
        self._checked: Counter[Source] = Counter()
        self._message_warnings: dict[str, None] = {}

    def readings_with_messages(self) -> Iterator[tuple[Reading, Any]]:
        """Yield each usable reading with the message it was decoded from, in log order."""
        for source, msg in self._messages():
            try:
                reading = self._decoder.decode(source, msg)
            except RefusedMessage:
                continue
            self._checked[source] += 1
            if self._checked[source] % _CHECK_INTERVAL == 1:
                self._message_warnings |= dict.fromkeys(message_warnings(source, msg))
            yield reading, msg

    def _messages(self) -> Iterator[tuple[Source, Any]]:
        source_of, observer = source_by_topic(self.topics), self._observer
        further = () if observer is None else observer.topics
        for topic, log_ns, msg in messages_of(self._bag, self.topics, further, self._progress):
            if observer is not None:
                observer.add(topic, log_ns, msg)
            source = source_of.get(topic)
            if source is not None:
                yield source, msg

    def readings(self) -> Iterator[Reading]:
        """Yield each usable reading, in log order; `absent_command` if no command is read."""
        for reading, _ in self.readings_with_messages():
            yield reading
            if self.topics.command is None and reading.source is Source.ODOMETRY:
                yield absent_command(reading)

    @property
    def measures_v_y(self) -> bool:
        """Whether a message of odometry measured v_y, as far as the messages say so."""
        return self._decoder.measures_v_y

    def message_warnings(self) -> list[str]:
        """Return one line per fault of frames and covariances, see `signals.message_checks`."""
        return list(self._message_warnings)

    def refusals(self, source: Source | None = None) -> list[str]:
        """Return one line per reason for which messages (of `source`) were refused."""
        return [
            f"{count} {refused.name.lower()} messages refused: {reason}"
            for (refused, reason), count in sorted(self._decoder.refused.items())
            if source is None or refused is source
        ]

    def warnings(self) -> list[str]:
        """Return the bag's warnings, then others prefixed with the bag's name."""
        others = self._tf_warnings + self.refusals()
        return self._bag.warnings + [f"{self._bag.path.name}: {x}" for x in others]

    def _with_extrinsics(self, sensors: SensorConfig) -> SensorConfig:
        """Return a configuration with the pose of the IMU that the bag's `/tf_static` gives."""
        bag, topics = self._bag, self.topics
        published = {info.name for info in bag.topics if info.msgtype == MSGTYPE}
        parts = topics.odometry.split("/")[:-1]
        # Of several cars, the transforms in the namespace of this one.
        nearest = ("/".join(parts[:n]) + TOPIC for n in range(len(parts), 0, -1))
        names = [name for name in nearest if name in published][:1]
        if not names or topics.imu is None or not wants_extrinsics(sensors):
            return sensors
        transforms = StaticTransforms()
        try:
            for _, _, msg in bag.messages(names):
                transforms.add(msg)
        except DataError as error:
            reason = str(error).removeprefix(f"bag {bag.path}: ")
            self._tf_warnings.append(
                f"the pose of the IMU is not read ({reason}), and taken to be that of odometry's "
                "child frame: set imu_position and imu_rotation, or use_tf: false if it is right"
            )
            return sensors
        vehicle, imu = (_first_frame(bag, topic) for topic in (topics.odometry, topics.imu))
        return with_extrinsics(sensors, transforms, vehicle, imu)


def read_recording(
    path: Path | str,
    options: RecordingOptions | None = None,
    progress: Progress | None = None,
    observer: MessageObserver | None = None,
) -> Recording:
    """
    Read a bag into a record.

    :param observer: sees the messages of the bag in the same pass.
    :raises UsageError, DataError: the bag cannot be read, lacks a topic, or yields no sample.
    """
    options = options or RecordingOptions()
    name = Path(path).name
    with Bag(path) as bag:
        reader = RecordingReader(bag, options, progress, observer)
        has_command = reader.topics.command is not None
        plausibility = Plausibility(options.sensors.reference_point, has_command)
        counts: dict[str, int] = {}
        commands: list[Reading] = []
        stream = plausibility.watch(_collecting_commands(reader.readings(), commands))
        try:
            record = build_record(stream, name, counts, plausibility.add)
        except DataError as error:
            refused = "; ".join(reader.refusals())
            raise DataError(f"{error}{f' ({refused})' if refused else ''}") from None
        warnings = reader.warnings()
        start_ns = bag.start_ns
    if not reader.measures_v_y:
        record = replace(record, estimated=("v_y",))
    details = [f"{count} times {event}" for event, count in counts.items()]
    details += plausibility.warnings() + reader.message_warnings()
    details += [] if has_command else [NO_COMMAND_WARNING]
    warnings += [f"{name}: {text}" for text in details]
    return Recording(
        record, reader.topics, warnings, start_ns, commands, reader.sensors, reader.extrinsics
    )


def _first_frame(bag: Bag, topic: str) -> str:
    """Return the frame of a topic's first message; empty if it has none."""
    return next((frame_of(msg) for _, _, msg in bag.messages([topic])), "")


def _collecting_commands(
    readings: Iterable[Reading], commands: list[Reading]
) -> Iterator[Reading]:
    for reading in readings:
        if reading.source is Source.COMMAND:
            commands.append(reading)
        yield reading
