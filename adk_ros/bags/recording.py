# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag as a drive: topics found, messages decoded and aligned. Used by every offline verb."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from adk_ros.bags import Bag, Topics, find_topics
from adk_ros.errors import DataError
from adk_ros.signals.channels import Reading, Record, Source
from adk_ros.signals.decode import Decoder, RefusedMessage, SensorConfig
from adk_ros.signals.plausibility import Plausibility
from adk_ros.signals.record import build_record

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class RecordingOptions:
    """How to read a drive: topic names (None: found by type) and the vehicle's sensors."""

    imu: str | None = None
    odometry: str | None = None
    command: str | None = None
    use_imu: bool = True
    sensors: SensorConfig = field(default_factory=SensorConfig)


@dataclass
class Recording:
    """
    A bag's record, and what a person should know of how it was read.

    `start_ns`: log time of the bag's first message. `commands`: the readings themselves, which a
    record only tells at its ticks.
    """

    record: Record
    topics: Topics
    warnings: list[str]
    start_ns: int
    commands: list[Reading]


def choose_topics(bag: Bag, options: RecordingOptions) -> Topics:
    """
    Find the topics of `bag`, or check those that the options name.

    :raises UsageError, DataError: as `bags.find_topics`.
    """
    topics = find_topics(
        bag, options.imu, options.odometry, options.command, options.sensors.command_type
    )
    if not options.use_imu:
        topics = Topics(None, topics.odometry, topics.command, topics.steering)
    return topics


def sources(topics: Topics) -> dict[str, Source]:
    """Topic name -> stream."""
    found = {topics.odometry: Source.ODOMETRY, topics.command: Source.COMMAND}
    if topics.imu is not None:
        found[topics.imu] = Source.IMU
    if topics.steering is not None:
        found[topics.steering] = Source.STEERING
    return found


def readings(
    bag: Bag, topics: Topics, decoder: Decoder, progress: Progress | None = None
) -> Iterator[Reading]:
    """Yield the bag's readings in log order; what cannot be used is counted by the decoder."""
    source_of = sources(topics)
    total = sum(info.count for info in bag.topics if info.name in source_of)
    for done, (topic, _, msg) in enumerate(bag.messages(source_of), start=1):
        if progress is not None and (done % 2000 == 0 or done == total):
            progress(done, total)
        try:
            yield decoder.decode(source_of[topic], msg)
        except RefusedMessage:
            continue


def read_recording(
    path: Path | str, options: RecordingOptions | None = None, progress: Progress | None = None
) -> Recording:
    """
    Read a bag into a record.

    :raises UsageError, DataError: the bag cannot be read, lacks a topic, or yields no sample.
    """
    options = options or RecordingOptions()
    decoder = Decoder(options.sensors)
    plausibility = Plausibility()
    with Bag(path) as bag:
        topics = choose_topics(bag, options)
        counts: dict[str, int] = {}
        commands: list[Reading] = []
        stream = plausibility.watch(readings(bag, topics, decoder, progress))
        try:
            record = build_record(
                _keeping(stream, commands), Path(path).name, counts, plausibility.add
            )
        except DataError as error:
            refused = "; ".join(_refusals(decoder))
            raise DataError(f"{error}{f' ({refused})' if refused else ''}") from None
        warnings = list(bag.warnings)
        start_ns = bag.start_ns
    warnings += [f"{record.name}: {text}" for text in _refusals(decoder)]
    warnings += [f"{record.name}: {count} times {what}" for what, count in counts.items()]
    warnings += [f"{record.name}: {text}" for text in plausibility.warnings()]
    warnings += [f"{record.name}: {text}" for text in _never_measured(record)]
    return Recording(record, topics, warnings, start_ns, commands)


def _keeping(stream: Iterable[Reading], commands: list[Reading]) -> Iterator[Reading]:
    for reading in stream:
        if reading.source is Source.COMMAND:
            commands.append(reading)
        yield reading


def _never_measured(record: Record) -> list[str]:
    """A channel that is the same number throughout, though the car moves."""
    x = record.x_ref[np.isfinite(record.x_ref).all(axis=1)]
    if len(x) < 400 or np.ptp(x[:, 0]) < 1.0:
        return []
    # The reference point's shift puts yaw rate into v_y: what counts is what odometry said.
    return [
        f"odometry's {name} is {x[0, i]:g} throughout: it is not measured, and what is learned "
        "of it means nothing"
        for i, name in ((1, "v_y"), (2, "yaw rate"))
        if np.ptp(x[:, i]) == 0.0
    ]


def _refusals(decoder: Decoder) -> list[str]:
    return [
        f"{count} {source.name.lower()} messages refused: {reason}"
        for (source, reason), count in sorted(decoder.refused.items())
    ]
