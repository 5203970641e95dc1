# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read bags: topics, time span, messages in log order, warnings about lost data."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from adk_ros.bags.decoding import Decoder, NoTypeError, deserialiser, to_cdr
from adk_ros.bags.files import storage_files
from adk_ros.bags.opening import NoBagError, StorageFile, open_storage
from adk_ros.bags.storage import Channel
from adk_ros.errors import DataError, UsageError, one_line

_TOPICS_SHOWN = 12
"""Topics in a summary line; more do not fit a one-line message."""

_DecoderFactory = Callable[[Channel], Decoder]
_Undecoded = tuple[int, Channel, Decoder, bytes]
_Decoded = tuple[Channel, int, Any]


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a bag: name, ROS 2 message type, number of messages."""

    name: str
    msgtype: str
    count: int


class Bag:
    """
    A recording opened for reading; a context manager.

    `path` is a rosbag2 folder, its `metadata.yaml`, one of its storage files, or a ROS 1 .bag.
    `start_ns` and `end_ns` are the first and last log time, `message_count` the number of
    readable messages. `warnings` has one line per damaged or missing part; reading may add more.

    :raises UsageError: `path` does not exist or is not a bag.
    :raises DataError: the bag has no message, or is damaged beyond reading.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.warnings: list[str] = []
        self._stack = ExitStack()
        self._storages: list[StorageFile] = []
        try:
            self._open()
        except BaseException:
            self._stack.close()
            raise

    def _open(self) -> None:
        files, expected = storage_files(self.path, self._warn)
        for file in files:
            try:
                self._storages.append(open_storage(file, self._stack))
            except NoBagError as error:
                if len(files) == 1:
                    raise DataError(f"bag {self.path}: {file.name} {error}") from None
                self._warn(f"{file.name} {error}: read without it")
            except OSError as error:
                raise UsageError(f"bag {self.path}: cannot read {file}: {error}") from None
        nonempty = [x.storage for x in self._storages if any(c.count for c in x.storage.channels)]
        if not nonempty:
            faults = [f": {x.storage.fault}" for x in self._storages if x.storage.fault]
            raise DataError(f"bag {self.path} contains no messages{''.join(faults[:1])}")
        counts: Counter[tuple[str, str]] = Counter()
        for x in self._storages:
            for channel in x.storage.channels:
                counts[channel.topic, channel.msgtype] += channel.count
        self.topics = [TopicInfo(name, kind, n) for (name, kind), n in sorted(counts.items())]
        self.message_count = sum(counts.values())
        self.start_ns = min(x.start_ns for x in nonempty)
        self.end_ns = max(x.end_ns for x in nonempty)
        for x in self._storages:
            if x.storage.fault:
                count = sum(channel.count for channel in x.storage.channels)
                end_s = self._seconds(x.storage.end_ns) if count else 0.0
                self._warn(
                    f"{x.name} is damaged or cut off after {end_s:.1f} s: {x.storage.fault}; "
                    f"{count} messages read"
                )
        if expected is not None and expected != self.message_count:
            self._warn(
                f"metadata.yaml lists {expected} messages, the bag has {self.message_count}"
            )

    def _seconds(self, log_ns: int) -> float:
        return (log_ns - self.start_ns) * 1e-9

    def _warn(self, text: str) -> None:
        if (line := one_line(text)) not in self.warnings:
            self.warnings.append(line)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last log time, s."""
        return self._seconds(self.end_ns)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, int, Any]]:
        """
        Yield (topic, log time in ns, message) in log order, of the given topics or of all.

        Messages have the attributes of their ROS 2 type. A message that cannot be decoded is
        skipped and counted in `warnings`, as is a topic of unknown type that was not named.

        :raises UsageError: a given topic is not in the bag.
        :raises DataError: the type of a given topic is not defined.
        """
        return ((x.topic, t, m) for x, t, m in self._decoded(topics, deserialiser))

    def raw(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, str, int, bytes]]:
        """Yield (topic, ROS 2 type, log time in ns, CDR bytes) as `messages` does."""
        return ((x.topic, x.msgtype, t, m) for x, t, m in self._decoded(topics, to_cdr))

    def _decoded(
        self, topics: Collection[str] | None, make_decoder: _DecoderFactory
    ) -> Iterator[_Decoded]:
        names = {x.name for x in self.topics}
        topics = [topics] if isinstance(topics, str) else topics
        selected = names if topics is None else set(topics)
        if absent := sorted(selected - names):
            raise UsageError(
                f"bag {self.path} has no topic {', '.join(absent)}; it has {self.summary()}"
            )
        sources = []
        for file in self._storages:
            decoders: dict[int, tuple[Channel, Decoder]] = {}
            for channel in file.storage.channels:
                if channel.topic in selected and channel.count:
                    try:
                        decoders[channel.id] = (channel, make_decoder(channel))
                    except NoTypeError as error:
                        if topics is not None:
                            raise DataError(f"bag {self.path}: {error}") from None
                        self._warn(f"{error}: {channel.count} messages skipped")
            sources.append(self._file_messages(file, decoders))
        return self._decode(sources)

    def _decode(self, sources: list[Iterator[_Undecoded]]) -> Iterator[_Decoded]:
        bad: dict[str, tuple[int, int, str]] = {}
        latest_ns = self.start_ns
        try:
            for log_ns, channel, decode, data in heapq.merge(*sources, key=lambda x: x[0]):
                # Untrusted bytes in a generated decoder: any exception means a bad message.
                try:
                    # An index is in order: a chunk whose times are not those of it is damaged.
                    if log_ns < latest_ns:
                        raise ValueError("logged before the message before it")
                    content = decode(data)
                except Exception as error:
                    count, first_ns, why = bad.get(channel.topic, (0, log_ns, _reason(error)))
                    bad[channel.topic] = (count + 1, first_ns, why)
                    continue
                latest_ns = log_ns
                yield channel, log_ns, content
        finally:
            for topic, (count, first_ns, why) in bad.items():
                self._warn(
                    f"{topic}: {count} messages cannot be decoded and are skipped, the first at "
                    f"{self._seconds(first_ns):.1f} s: {why}"
                )

    def _file_messages(
        self, file: StorageFile, decoders: dict[int, tuple[Channel, Decoder]]
    ) -> Iterator[_Undecoded]:
        """Yield the messages of one file; if its index is damaged, continue without the index."""
        seen: Counter[int] = Counter()
        expected = sum(channel.count for channel, _ in decoders.values())
        last_ns = self.start_ns
        try:
            for key, last_ns, data in file.storage.messages(decoders):
                seen[key] += 1
                yield (last_ns, *decoders[key], data)
            if seen.total() >= expected:
                return
            reason = "the index does not list every message"
        except Exception as error:
            reason = _reason(error)
        scan = file.scan()
        self._stack.callback(scan.close)
        count = seen.total()
        for key, log_ns, data in scan.messages(decoders):
            # Order within a topic is the same: messages yielded before come first.
            if seen[key]:
                seen[key] -= 1
                continue
            count += 1
            yield (log_ns, *decoders[key], data)
        if count < expected:
            self._warn(
                f"{file.name} is damaged after {self._seconds(last_ns):.1f} s: {reason}; "
                f"{count} of {expected} messages read"
            )

    def summary(self) -> str:
        """Return topics, types and message counts on one line."""
        shown = [f"{x.name} ({x.msgtype}, {x.count})" for x in self.topics[:_TOPICS_SHOWN]]
        more = len(self.topics) - len(shown)
        return one_line(", ".join(shown) + (f" and {more} more" if more > 0 else ""))

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_bag(path: Path | str) -> Bag:
    """Open the bag at `path`; see `Bag`."""
    return Bag(path)


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__
