# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bags: rosbag2 (mcap, sqlite3) and ROS 1 recordings in, rosbag2 recordings out.

A bag is read from its storage files; `metadata.yaml` only says which they are and how much they
should hold. So a recording whose recorder was killed, or whose disk ran full, is read up to the
cut (`bag_recovery`), and what is lost is said in `Bag.warnings`. Every message type is read by the
definition that the bag itself carries, and by that alone: one that cannot be understood hinders no
other. Types without a definition are taken from ROS 2 Jazzy's common interfaces.
"""

from __future__ import annotations

import heapq
import re
import shutil
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Connection, MessageDefinitionFormat, Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    Reader,
    StoragePlugin,
    Writer,
    WriterError,
)
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore
from ruamel.yaml import YAML

from adk_ros.bag_recovery import (
    END_OF_TIME,
    MCAP_MAGIC,
    ROS1_MAGIC,
    SQLITE_MAGIC,
    ZSTD_MAGIC,
    Channel,
    McapScan,
    RawMessage,
    Ros1Scan,
    Scan,
    SqliteScan,
    Storage,
    inflate,
    inflate_file,
    ros2_type,
    sqlite_pages,
)
from adk_ros.errors import DataError, UsageError

IMU_TYPE = "sensor_msgs/msg/Imu"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
STEERING_TYPE = "autoware_vehicle_msgs/msg/SteeringReport"
COMMAND_TYPES = {
    "joint_state": "sensor_msgs/msg/JointState",
    "ackermann": "ackermann_msgs/msg/AckermannDriveStamped",
    "autoware_control": "autoware_control_msgs/msg/Control",
}

_HEADER = "std_msgs/msg/Header"
_STORAGE_SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_TOPICS_SHOWN = 12


@lru_cache(maxsize=1)
def _jazzy() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def add_type(msgtype: str, definition: str) -> None:
    """
    Teach `message` and `BagWriter` a type that ROS 2's common interfaces lack.

    `definition` is the text of its .msg file, with those of the types it uses appended as in
    rosbag2: a line of 80 `=`, then `MSG: pkg/Type`, then the text.
    """
    _jazzy().register(get_types_from_msg(definition, msgtype))
    _typestore.cache_clear()


def message(msgtype: str, **fields: Any) -> Any:
    """
    Return a message of a ROS 2 type; fields that are not given are zero or empty.

    A nested message may be given as a mapping, a `builtin_interfaces/msg/Time` as integer
    nanoseconds, and an array as any sequence of numbers. Quaternions default to the identity.

    Raises:
        TypeError: the type is unknown, or it has no such field.
    """
    store = _jazzy()
    if msgtype not in store.types:
        raise TypeError(f"message type {msgtype} is unknown")
    if msgtype == "geometry_msgs/msg/Quaternion":
        fields = {"w": 1.0, **fields}
    values = {
        name: _field(desc, fields.pop(name)) if name in fields else _field(desc)
        for name, desc in store.fielddefs[msgtype][1]
    }
    if fields:
        raise TypeError(f"{msgtype} has no field {', '.join(fields)}")
    return store.types[msgtype](**values)


def _field(desc: FieldDesc, value: Any = None) -> Any:
    """Return a field's value in the form that rosbags serialises, its default where None."""
    if desc[0] == Nodetype.NAME:
        if value is None or isinstance(value, Mapping):
            return message(str(desc[1]), **(value or {}))
        if desc[1] == "builtin_interfaces/msg/Time" and isinstance(value, int | np.integer):
            return message(desc[1], sec=int(value // 10**9), nanosec=int(value % 10**9))
        return value
    if desc[0] == Nodetype.BASE:
        kind = desc[1][0]
        default = "" if "string" in kind else False if kind == "bool" else 0
        value = default if value is None else value
        return float(value) if "float" in kind else value
    (subkind, sub), length = desc[1]
    count = length if desc[0] == Nodetype.ARRAY else 0
    if subkind == Nodetype.NAME or "string" in sub[0]:
        item: Any = (subkind, sub)
        return [_field(item, x) for x in ([None] * count if value is None else value)]
    dtype = np.dtype({"char": "uint8"}.get(sub[0], sub[0]))
    return np.zeros(count, dtype) if value is None else np.asarray(value, dtype)


@lru_cache(maxsize=256)
def _typestore(
    msgtype: str, definition: str, definition_format: str, known: str
) -> Typestore | None:
    """
    Return a store with one type as its definition has it, or None where that is unknown.

    `known` says what may fill in for a definition that is missing: "all" of Jazzy's types, only
    its "header", which is to replace that of ROS 1 with its sequence number, or "none" of them
    but the time and the duration that are built in.
    """
    common = (_jazzy() if known == "all" else get_typestore(Stores.EMPTY)).fielddefs
    types: Typesdict = {}
    # A definition comes from outside: whatever its text makes the parser do, it is "unknown".
    with suppress(Exception):
        if "idl" in definition_format:
            types = _types_from_idl(definition)
        elif definition.strip():
            types = get_types_from_msg(definition, msgtype)
    if known == "header":
        types[_HEADER] = _jazzy().fielddefs[_HEADER]
    for defined in (types, {}):
        needed: Typesdict = {}
        pending = [msgtype]
        with suppress(Exception):
            while pending:
                name = pending.pop()
                if name not in needed:
                    needed[name] = defined[name] if name in defined else common[name]
                    pending += _nested(needed[name][1])
            store = get_typestore(Stores.EMPTY)
            store.register(needed)
            store.get_msgdef(msgtype)
            return store
    return None


def _types_from_idl(definition: str) -> Typesdict:
    types: Typesdict = {}
    for part in definition.split("=" * 80 + "\n"):
        head, _, text = part.partition("\n")
        if head.startswith("MSG: "):
            types.update(get_types_from_msg(text, ros2_type(head[5:].strip())))
        elif part.strip():
            text = text if head.startswith("IDL: ") else part
            # Every type has its part; rosbags does not know how to go by `#include`.
            types.update(get_types_from_idl(re.sub(r"(?m)^\s*#.*$", "", text)))
    return types


def _nested(fields: list[tuple[str, FieldDesc]]) -> list[str]:
    inner = [x[1][0] if x[0] in {Nodetype.ARRAY, Nodetype.SEQUENCE} else x for _, x in fields]
    return [str(x[1]) for x in inner if x[0] == Nodetype.NAME]


class _Indexed:
    """A storage file that rosbags reads by its index."""

    def __init__(self, reader: Any) -> None:
        self.fault = ""
        self._reader = reader
        reader.open()
        about = reader if isinstance(reader, Ros1Reader) else reader.metadata
        # An MCAP file whose chunks are not indexed is not sorted, one whose messages are not
        # counted seems to have none.
        if not (getattr(reader, "chunks", True) and about.message_count):
            reader.close()
            raise ValueError("the index says nothing")
        self.start_ns: int = about.start_time
        self.end_ns: int = about.end_time - 1
        self._connections = {connection.id: connection for connection in reader.connections}
        self.channels = [
            Channel(
                x.id,
                str(x.topic),
                str(x.msgtype),
                str(getattr(x.ext, "serialization_format", "ros1")),
                str(x.msgdef.data),
                "ros2idl" if x.msgdef.format == MessageDefinitionFormat.IDL else "ros2msg",
                x.msgcount,
            )
            for x in self._connections.values()
        ]

    def messages(self, ids: Collection[int]) -> Iterator[RawMessage]:
        chosen = [self._connections[i] for i in ids]
        if chosen:
            for connection, log_ns, data in self._reader.messages(chosen):
                yield RawMessage(connection.id, log_ns, data)

    def close(self) -> None:
        self._reader.close()


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a bag, its ROS 2 message type, and how many messages of it there are."""

    name: str
    msgtype: str
    count: int


@dataclass(frozen=True)
class Topics:
    """The topics that a drive is read from; `imu` and `steering` are None where there is none."""

    imu: str | None
    odometry: str
    command: str
    steering: str | None = None


class Bag:
    """
    A recording, opened for reading: a context manager, to be closed in any case.

    `path` is a rosbag2 folder, its `metadata.yaml`, one storage file of it, or a ROS 1 .bag.
    `start_ns` and `end_ns` are the first and the last log time, `message_count` what can be read.
    `warnings` says, a line each, what is damaged or missing; reading may add to it.

    Raises:
        UsageError: there is nothing at `path`, or nothing that is a bag.
        DataError: the bag holds no message, or is damaged beyond reading.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.warnings: list[str] = []
        self._stack = ExitStack()
        self._storages: list[_File] = []
        try:
            self._open()
        except BaseException:
            self._stack.close()
            raise

    def _open(self) -> None:
        files, expected = _storage_files(self.path, self._warn)
        for file in files:
            try:
                self._storages.append(_open_storage(file, self._stack))
            except _NoBagError as error:
                if len(files) == 1:
                    raise DataError(f"bag {self.path}: {file.name} {error}") from None
                self._warn(f"{file.name} {error}: read without it")
            except OSError as error:
                raise UsageError(f"bag {self.path}: cannot read {file}: {error}") from None
        held = [x.storage for x in self._storages if any(c.count for c in x.storage.channels)]
        if not held:
            faults = [f": {x.storage.fault}" for x in self._storages if x.storage.fault]
            raise DataError(f"bag {self.path} holds no messages{''.join(faults[:1])}")
        counts: Counter[tuple[str, str]] = Counter()
        for x in self._storages:
            for channel in x.storage.channels:
                counts[channel.topic, channel.msgtype] += channel.count
        self.topics = [TopicInfo(name, kind, n) for (name, kind), n in sorted(counts.items())]
        self.message_count = sum(counts.values())
        self.start_ns = min(x.start_ns for x in held)
        self.end_ns = max(x.end_ns for x in held)
        for x in self._storages:
            if x.storage.fault:
                kept = sum(channel.count for channel in x.storage.channels)
                end_s = self._seconds(x.storage.end_ns) if kept else 0.0
                self._warn(
                    f"{x.name} is damaged or cut off after {end_s:.1f} s: {x.storage.fault}; "
                    f"{kept} messages kept"
                )
        if expected is not None and expected != self.message_count:
            self._warn(
                f"metadata.yaml announces {expected} messages, {self.message_count} are there"
            )

    def _seconds(self, log_ns: int) -> float:
        return (log_ns - self.start_ns) * 1e-9

    def _warn(self, text: str) -> None:
        if (line := _line(text)) not in self.warnings:
            self.warnings.append(line)

    @property
    def duration_s(self) -> float:
        """Seconds from the first to the last log time."""
        return self._seconds(self.end_ns)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, int, Any]]:
        """
        Yield (topic, log time in ns, message) in log order, of all topics or of those named.

        Messages have the attributes of their ROS 2 type. One that cannot be decoded is skipped
        and counted in `warnings`; so is a topic of unknown type, unless it was asked for by name.

        Raises:
            UsageError: a topic that is named is not in the bag.
            DataError: a topic that is named is of a type which the bag does not define.
        """
        return ((x.topic, t, m) for x, t, m in self._decoded(topics, _deserialiser))

    def raw(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, str, int, bytes]]:
        """Yield (topic, ROS 2 type, log time in ns, CDR bytes), in order and refusals as above."""
        return ((x.topic, x.msgtype, t, m) for x, t, m in self._decoded(topics, _to_cdr))

    def _decoded(self, topics: Collection[str] | None, maker: _Maker) -> Iterator[_Decoded]:
        names = {x.name for x in self.topics}
        topics = [topics] if isinstance(topics, str) else topics
        wanted = names if topics is None else set(topics)
        if absent := sorted(wanted - names):
            raise UsageError(
                f"bag {self.path} has no topic {', '.join(absent)}; it has {self.summary()}"
            )
        sources = []
        for file in self._storages:
            known: dict[int, tuple[Channel, _Decoder]] = {}
            for channel in file.storage.channels:
                if channel.topic in wanted and channel.count:
                    try:
                        known[channel.id] = (channel, maker(channel))
                    except _NoTypeError as error:
                        if topics is not None:
                            raise DataError(_line(f"bag {self.path}: {error}")) from None
                        self._warn(f"{error}: {channel.count} messages skipped")
            sources.append(self._source(file, known))
        return self._decode(sources)

    def _decode(self, sources: list[Iterator[_Undecoded]]) -> Iterator[_Decoded]:
        bad: dict[str, tuple[int, int, str]] = {}
        try:
            for log_ns, channel, decode, data in heapq.merge(*sources, key=lambda x: x[0]):
                # The bytes are from outside, the decoder is generated: any exception means "bad".
                try:
                    content = decode(data)
                except Exception as error:
                    count, first_ns, why = bad.get(channel.topic, (0, log_ns, _reason(error)))
                    bad[channel.topic] = (count + 1, first_ns, why)
                    continue
                yield channel, log_ns, content
        finally:
            for topic, (count, first_ns, why) in bad.items():
                self._warn(
                    f"{topic}: {count} messages cannot be decoded and are skipped, the first at "
                    f"{self._seconds(first_ns):.1f} s: {why}"
                )

    def _source(
        self, file: _File, known: dict[int, tuple[Channel, _Decoder]]
    ) -> Iterator[_Undecoded]:
        """Yield one file's messages; where its index leads to damage, go on without the index."""
        seen: Counter[int] = Counter()
        announced = sum(channel.count for channel, _ in known.values())
        last_ns = self.start_ns
        try:
            for key, last_ns, data in file.storage.messages(known):
                seen[key] += 1
                yield (last_ns, *known[key], data)
            if seen.total() >= announced:
                return
            reason = "the index does not lead to every message"
        except Exception as error:
            reason = _reason(error)
        scan = file.scan()
        self._stack.callback(scan.close)
        kept = seen.total()
        for key, log_ns, data in scan.messages(known):
            # Log order within a topic is the same: what was given already comes first.
            if seen[key]:
                seen[key] -= 1
                continue
            kept += 1
            yield (log_ns, *known[key], data)
        if kept < announced:
            self._warn(
                f"{file.name} is damaged after {self._seconds(last_ns):.1f} s: {reason}; "
                f"{kept} of {announced} messages kept"
            )

    def summary(self) -> str:
        """Return the topics with their types and counts, on one line."""
        shown = [f"{x.name} ({x.msgtype}, {x.count})" for x in self.topics[:_TOPICS_SHOWN]]
        more = len(self.topics) - len(shown)
        return _line(", ".join(shown) + (f" and {more} more" if more > 0 else ""))

    def close(self) -> None:
        """Release the files."""
        self._stack.close()

    def __enter__(self) -> Bag:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def open_bag(path: Path | str) -> Bag:
    """Return the bag at `path`, opened: see `Bag`."""
    return Bag(path)


class _File(NamedTuple):
    """An opened storage file, and how to read it without its index."""

    name: str
    storage: Storage
    scan: Callable[[], Scan]


_Decoder = Callable[[bytes], Any]
_Maker = Callable[[Channel], _Decoder]
_Undecoded = tuple[int, Channel, _Decoder, bytes]
_Decoded = tuple[Channel, int, Any]


def _line(text: str) -> str:
    """Return a text on one line, whatever names and reasons from outside it quotes."""
    return " ".join(text.split())


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__


class _NoBagError(Exception):
    """A storage file holds nothing that can be read."""


class _NoTypeError(Exception):
    """A message type is neither defined in the bag nor one of the common ones."""


def _deserialiser(channel: Channel) -> _Decoder:
    ros1, msgtype = channel.encoding == "ros1", channel.msgtype
    store = _store_of(channel, "none" if ros1 else "all")
    if ros1:
        return lambda data: store.deserialize_ros1(data, msgtype)

    def decode(data: bytes) -> Any:
        data = inflate("zstd", data) if data[:4] == ZSTD_MAGIC else data
        try:
            return store.deserialize_cdr(data, msgtype)
        except Exception:
            # rclpy's serialize_message adds 4 bytes after a trailing empty sequence of doubles.
            return store.deserialize_cdr(data[:-4], msgtype)

    return decode


def _to_cdr(channel: Channel) -> _Decoder:
    if channel.encoding == "ros1":
        store = _store_of(channel, "header")
        return lambda data: bytes(store.ros1_to_cdr(data, channel.msgtype))
    return lambda data: inflate("zstd", data) if data[:4] == ZSTD_MAGIC else bytes(data)


def _store_of(channel: Channel, known: str) -> Typestore:
    if channel.encoding not in {"cdr", "ros1"}:
        raise _NoTypeError(f"{channel.topic} is encoded as {channel.encoding!r}, not CDR")
    store = _typestore(channel.msgtype, channel.definition, channel.definition_format, known)
    if store is None:
        raise _NoTypeError(f"{channel.topic}: type {channel.msgtype} is not defined in the bag")
    return store


def _open_storage(path: Path, stack: ExitStack) -> _File:
    """Open a storage file by its index, or by a scan where there is none or it is unsound."""
    file = path
    with file.open("rb") as stream:
        magic = stream.read(16)
    if magic[:4] == ZSTD_MAGIC:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="adk_bag_")))
        file = folder / path.stem
        inflate_file(path, file)
        with file.open("rb") as stream:
            magic = stream.read(16)
    reader: Any
    scan: type[Scan]
    if magic.startswith(MCAP_MAGIC):
        reader, scan = Reader.STORAGE_PLUGINS[".mcap"], McapScan
    elif magic.startswith(SQLITE_MAGIC):
        file = _with_log(file, stack)
        reader, scan = Reader.STORAGE_PLUGINS[".db3"], SqliteScan
    elif magic.startswith(ROS1_MAGIC):
        reader, scan = Ros1Reader, Ros1Scan
    else:
        raise _NoBagError("is neither MCAP, SQLite nor a ROS 1 bag" if magic else "is empty")
    storage: Storage
    # Files are from outside: whatever makes rosbags stumble, the scan finds out what there is.
    try:
        if scan is SqliteScan:
            with file.open("rb") as stream:
                size, pages = sqlite_pages(stream.read(32))
            if size * pages != file.stat().st_size:
                raise ValueError("SQLite answers for what its tree still reaches, and is silent")
        storage = _Indexed(reader(file))
    except Exception:
        storage = scan(file)
    stack.callback(storage.close)
    return _File(path.name, storage, lambda: scan(file))


def _with_log(file: Path, stack: ExitStack) -> Path:
    """Return a database with its write-ahead log worked in, in a copy: bags are never altered."""
    log = file.with_name(file.name + "-wal")
    if not log.is_file() or not log.stat().st_size:
        return file
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="adk_bag_")))
    copy = folder / file.name
    shutil.copyfile(file, copy)
    shutil.copyfile(log, folder / log.name)
    with suppress(sqlite3.Error), closing(sqlite3.connect(copy)) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    return copy


def _storage_files(path: Path, warn: Callable[[str], None]) -> tuple[list[Path], int | None]:
    """Return a bag's storage files, and the number of messages announced for them, if any."""
    if path.name == "metadata.yaml":
        path = path.parent
    try:
        if not path.exists():
            raise UsageError(f"bag {path} does not exist")
        if path.is_file():
            return [path], None
        present = sorted((x for x in path.iterdir() if x.is_file()), key=_natural)
    except OSError as error:
        raise UsageError(f"bag {path}: cannot read it: {error.strerror}") from None
    stored = [x for x in present if x.name.endswith(_STORAGE_SUFFIXES)]
    # Playing a compressed bag leaves the unpacked file beside the packed one.
    names = {x.name for x in stored}
    stored = [x for x in stored if x.suffix != ".zstd" or x.stem not in names]
    if not stored:
        others = [x.name for x in present if x.suffix == ".bag"]
        others += sorted(x.parent.name for x in path.glob("*/metadata.yaml"))
        hint = f"name a bag in it: {', '.join(others[:5])}" if others else "no .mcap or .db3 in it"
        raise UsageError(f"{path} is not a rosbag2 folder: {hint}")
    try:
        about = YAML(typ="safe").load(path / "metadata.yaml")["rosbag2_bagfile_information"]
        listed = [path / Path(x).name for x in about["relative_file_paths"]]
        expected = int(about["message_count"])
    except FileNotFoundError:
        # The files of one recording differ in their number alone.
        if len({(re.sub(r"_\d+$", "", x.stem), x.suffix) for x in stored}) > 1:
            shown = ", ".join(x.name for x in stored[:5])
            raise UsageError(f"{path} holds several recordings: name one of {shown}") from None
        warn("metadata.yaml is missing: the recording was not closed")
        return stored, None
    except Exception:  # the file is from outside, and its parser raises whatever it likes
        warn("metadata.yaml cannot be understood: read without it")
        return stored, None
    missing = [x.name for x in listed if not x.is_file()]
    if missing or not listed:
        warn(f"metadata.yaml lists {', '.join(missing) or 'no file'}: read what is there instead")
        return stored, expected
    return listed, expected


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key by which bag_2 comes before bag_10."""
    return [(int(x), "") if x.isdigit() else (0, x) for x in re.split(r"(\d+)", path.name)]


def find_topics(
    bag: Bag,
    imu: str | None = None,
    odometry: str | None = None,
    command: str | None = None,
    command_type: str = "joint_state",
    steering: str | None = None,
) -> Topics:
    """
    Return the topics to read a drive from: those named, else the only one of its type.

    Topics without messages are not considered. The IMU is optional, as is the steering report,
    which is looked for with `command_type` "autoware_control" alone; naming either as the empty
    string does without it.

    Raises:
        UsageError: a topic that is named is absent or of another type; unknown `command_type`.
        DataError: a needed topic is missing, or there are several to choose from.
    """
    if command_type not in COMMAND_TYPES:
        known = ", ".join(COMMAND_TYPES)
        raise UsageError(f"command type {command_type!r} is unknown: choose one of {known}")
    wants_steering = command_type == "autoware_control"
    return Topics(
        imu=_optional(bag, "imu", imu, IMU_TYPE),
        odometry=_needed(bag, "odometry", odometry, ODOMETRY_TYPE),
        command=_needed(bag, "command", command, COMMAND_TYPES[command_type]),
        steering=_optional(bag, "steering", steering, STEERING_TYPE) if wants_steering else None,
    )


def _needed(bag: Bag, role: str, name: str | None, msgtype: str) -> str:
    found = _optional(bag, role, name, msgtype)
    if found is None:
        raise DataError(
            f"bag {bag.path}: no {role}: no topic of type {msgtype} with messages; "
            f"it has {bag.summary()}"
        )
    return found


def _optional(bag: Bag, role: str, name: str | None, msgtype: str) -> str | None:
    if name == "":
        return None
    if name is not None:
        types = [x.msgtype for x in bag.topics if x.name == name]
        if not types:
            raise UsageError(
                f"bag {bag.path}: --{role} {name} is not in it; it has {bag.summary()}"
            )
        if msgtype not in types:
            raise UsageError(
                f"bag {bag.path}: --{role} {name} is {types[0]}, but {msgtype} is needed"
            )
        if not any(x.count for x in bag.topics if x.name == name and x.msgtype == msgtype):
            raise DataError(f"bag {bag.path}: --{role} {name} has no messages")
        return name
    found = [x.name for x in bag.topics if x.msgtype == msgtype and x.count]
    if len(found) > 1:
        raise DataError(
            f"bag {bag.path}: {len(found)} topics of type {msgtype}: {', '.join(found)}; "
            f"choose one with --{role} NAME"
        )
    return found[0] if found else None


class BagWriter:
    """
    A new rosbag2 folder at `path`, open for writing: a context manager.

    `storage` is "mcap" or "sqlite3"; `compression` None or "zstd", which packs the chunks of an
    mcap file and a sqlite3 file as a whole: messages of some hundred bytes hardly shrink one by
    one. The bag is closed in order after an exception too, holding what was written until then.

    Raises:
        UsageError: `path` exists already or cannot be written, or an argument is not known.
    """

    def __init__(
        self, path: Path | str, storage: str = "mcap", compression: str | None = None
    ) -> None:
        self.path = Path(path)
        plugins = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
        if storage not in plugins:
            raise UsageError(f"storage {storage!r} is unknown: choose mcap or sqlite3")
        if compression not in {None, "zstd"}:
            raise UsageError(f"compression {compression!r} is unknown: choose zstd or none")
        if self.path.exists():
            raise UsageError(f"{self.path} exists already: choose another --out or remove it")
        self._connections: dict[str, Connection] = {}
        with self._refusing():
            self._writer: Writer | None = Writer(
                self.path, version=9, storage_plugin=plugins[storage]
            )
            if compression == "zstd":
                packed = {"mcap": CompressionMode.STORAGE, "sqlite3": CompressionMode.FILE}
                self._writer.set_compression(packed[storage], CompressionFormat.ZSTD)
            self._writer.open()

    @contextmanager
    def _refusing(self) -> Iterator[None]:
        try:
            yield
        except (OSError, WriterError, sqlite3.Error) as error:
            raise UsageError(f"bag {self.path} cannot be written: {error}") from error

    def _opened(self) -> Writer:
        if self._writer is None:
            raise UsageError(f"bag {self.path} is closed")
        return self._writer

    def add_topic(self, name: str, msgtype: str) -> None:
        """Declare a topic; a second time with the same type is without effect."""
        writer = self._opened()
        if name in self._connections:
            if (declared := self._connections[name].msgtype) != msgtype:
                raise UsageError(f"bag {self.path}: {name} is declared as {declared} already")
            return
        if msgtype not in _jazzy().types:
            raise UsageError(f"bag {self.path}: {name}: message type {msgtype} is unknown")
        with self._refusing():
            self._connections[name] = writer.add_connection(name, msgtype, typestore=_jazzy())

    def write(self, topic: str, msg: Any, log_ns: int) -> None:
        """Write one message: an object such as `message` makes, or CDR bytes; log time in ns."""
        writer = self._opened()
        if topic not in self._connections:
            raise UsageError(f"bag {self.path}: topic {topic} was not declared")
        if not 0 <= log_ns < END_OF_TIME:
            raise UsageError(f"bag {self.path}: {topic}: log time {log_ns} ns is out of range")
        connection = self._connections[topic]
        if not isinstance(msg, bytes | bytearray | memoryview):
            msg = _jazzy().serialize_cdr(msg, connection.msgtype)
        with self._refusing():
            writer.write(connection, log_ns, msg)

    def close(self) -> None:
        """Write the index and `metadata.yaml`; a second call is without effect."""
        writer, self._writer = self._writer, None
        if writer is not None:
            with self._refusing():
                writer.close()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
