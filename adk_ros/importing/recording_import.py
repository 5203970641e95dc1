# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Import files as a bag by a map: read, convert, join, write."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from heapq import merge
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bags import BagWriter
from adk_ros.errors import DataError
from adk_ros.importing.channels import CHANNELS
from adk_ros.importing.computed_channels import with_computed
from adk_ros.importing.map_file import ImportMap
from adk_ros.importing.source_channels import SourceChannel, source_channels
from adk_ros.importing.source_files import open_tables
from adk_ros.importing.streams import rate_hz
from adk_ros.importing.topics import Outcome, topics_of

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class ImportedRecording:
    """
    What was imported.

    `channels`: at the stamps of their sources. `outcome`: the topics, and by channel why it was
    left out. `notes`: losses, interpolation and assumptions, one line each. `unused`: columns of
    the files that the map does not name.
    """

    channels: tuple[SourceChannel, ...]
    outcome: Outcome
    notes: tuple[str, ...]
    unused: tuple[str, ...]

    @property
    def message_count(self) -> int:
        """Messages of all topics."""
        return sum(len(topic.stream) for topic in self.outcome.topics)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last message, s."""
        stamps = [topic.stream.stamp_ns for topic in self.outcome.topics if len(topic.stream)]
        first, last = min(x[0] for x in stamps), max(x[-1] for x in stamps)
        return float(last - first) * 1e-9

    def rows(self) -> list[dict[str, Any]]:
        """Return a row per channel: source, conversion, rate, number and range of values."""
        return [
            {
                "channel": channel.name,
                "source": channel.column,
                "table": channel.table,
                "unit": channel.entry.unit,
                "factor": channel.factor * channel.entry.sign * channel.entry.scale
                / channel.entry.ratio,
                "offset": channel.entry.offset,
                "rate_hz": round(rate_hz(channel.stamp_ns), 3),
                "count": int(channel.values.shape[0]),
                "min": float(np.min(channel.values)),
                "max": float(np.max(channel.values)),
                "si_unit": CHANNELS[channel.name].unit,
                "not_imported": self.outcome.left_out.get(channel.name),
            }
            for channel in self.channels
        ]  # fmt: skip


def read_channels(
    files: Sequence[Path], import_map: ImportMap, map_name: str, databases: Sequence[Path]
) -> ImportedRecording:
    """
    Return the channels of files, joined to topics.

    :param map_name: name of the map, for messages. :param databases: DBC files of CAN logs.
    :raises UsageError: a file or column is missing, or a library is not installed.
    :raises DataError: a file cannot be read, or nothing can be written.
    """
    notes: list[str] = []
    tables = open_tables(files, import_map.files, databases, notes)
    channels = source_channels(tables, import_map, map_name, notes)
    notes += _losses(channels)
    used: set[tuple[str, str | None]] = {(channel.table, channel.column) for channel in channels}
    channels = with_computed(channels, import_map, map_name, notes)
    outcome = topics_of(channels, notes)
    outcome.topics = [topic for topic in outcome.topics if len(topic.stream)]
    if not outcome.topics:
        reasons = "; ".join(f"{name}: {why}" for name, why in outcome.left_out.items())
        raise DataError(f"{map_name}: no message can be written: {reasons or 'no common time'}")
    times = [import_map.time, *(each.time for each in import_map.files.values())]
    used |= {
        (table.label, table.find(time.column))
        for table in tables
        for time in times
        if time is not None and time.column is not None
    }
    unused = [
        column for table in tables for column in table.columns if (table.label, column) not in used
    ]
    return ImportedRecording(tuple(channels), outcome, tuple(notes), tuple(unused))


def _losses(channels: Sequence[SourceChannel]) -> list[str]:
    """Return a line for each kind of cell that holds no value, with the channels it is in."""
    kinds: dict[str, list[str]] = {}
    for channel in channels:
        rows = channel.values.shape[0] + channel.empty + channel.texts + channel.duplicates
        for count, what in (
            (channel.empty, "are empty"),
            (channel.texts, "are no number"),
            (channel.duplicates, "repeat the time of another row"),
        ):
            if count:
                kinds.setdefault(f"{count} of {rows} cells {what}", []).append(channel.name)
    return [f"{', '.join(names)}: {text}: skipped" for text, names in kinds.items()]


def write_recording(
    recording: ImportedRecording, out: Path, progress: Progress | None = None
) -> None:
    """
    Write the topics as a rosbag2 folder; the log time of a message is its stamp.

    :raises UsageError: `out` exists or cannot be written.
    """
    topics, total = recording.outcome.topics, recording.message_count
    with BagWriter(out, compression="zstd") as writer:
        for topic in topics:
            writer.add_topic(topic.name, topic.msgtype)
        streams = [topic.messages() for topic in topics]
        for done, (stamp_ns, name, msg) in enumerate(
            merge(*streams, key=lambda item: item[0]), start=1
        ):
            writer.write(name, msg, stamp_ns)
            if progress is not None and (done % 2000 == 0 or done == total):
                progress(done, total)
