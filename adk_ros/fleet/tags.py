# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`fleet.csv`: vehicle, time and conditions of each recording."""

from __future__ import annotations

import csv
import io
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from functools import partial
from pathlib import Path

from adk_ros.errors import UsageError
from adk_ros.fleet.recordings import FleetRecording
from adk_ros.fleet.store import file_system, with_retries

TAGS_FILE = "fleet.csv"
_COLUMNS = ("recording", "vehicle", "time")
_MAX_NAMED = 3


@dataclass(frozen=True)
class Tags:
    """
    What `fleet.csv` says about a recording.

    `vehicle`: name of the car, "" if unknown. `time_s`: when it was recorded, s since 1970 UTC,
    None if unknown. `conditions`: the other columns by name, such as rain, tyres, software.
    """

    vehicle: str = ""
    time_s: float | None = None
    conditions: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class TagTable:
    """
    What a table says about recordings.

    `path` or URL, "" for none. `tags`: name of recording -> its tags, of those that it lists.
    `notes`: how many rows match no recording, and how many recordings have no row.
    """

    path: str = ""
    tags: Mapping[str, Tags] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def tags_beside(given: Sequence[str]) -> str | None:
    """
    Return path or URL of fleet.csv in the folder of the recordings, None if there is none.

    :param given: folders, globs and URLs; the folder of a glob is its path before the first
        wildcard.
    :raises UsageError: there are several. :raises StoreUnreachable: a store does not answer.
    """
    files = dict.fromkeys(f"{_folder(uri)}/{TAGS_FILE}" for uri in given)
    present = [file for file in files if _is_file(file)]
    if len(present) > 1:
        raise UsageError(
            f"{present[0]} and {present[1]}: name one file for all recordings with --tags"
        )
    return present[0] if present else None


def _folder(uri: str) -> str:
    """Return a folder or URL without its wildcards, and without a slash at its end."""
    protocol, separator, path = uri.rpartition("://")
    fixed = re.split(r"[*?\[]", path)[0]
    if fixed != path:
        fixed = fixed.rpartition("/")[0] or ("" if path.startswith("/") or protocol else ".")
    return f"{protocol}{separator}{fixed.rstrip('/')}"


def _is_file(uri: str) -> bool:
    system, path = file_system(uri)
    try:
        return bool(with_retries(uri, partial(system.info, path))["type"] == "file")
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError as error:
        raise UsageError(f"{uri} cannot be read: {error.strerror or error}") from None


def read_tags(path: Path | str, recordings: Sequence[FleetRecording]) -> TagTable:
    """
    Return the tags of recordings; recordings that the file does not list have none.

    Columns recording, vehicle and time (ISO 8601; without an offset UTC), then any others.
    `recording` is the name of a recording or its path below the folder of the table, with or
    without the ending of its file, or the folder that it lies in alone.

    :param path: on the disk, or URL.
    :raises UsageError: the file cannot be read, a column or value is missing or wrong, a recording
        is listed twice, or none is listed; the message names line and column.
    :raises StoreUnreachable: its store does not answer.
    """
    known = {recording.name: recording.name for recording in recordings}
    folder = f"{file_system(str(path))[1].rpartition('/')[0]}/"
    for recording in recordings:
        # Of a glob with several wildcards, names are shorter than paths below its folder.
        if (place := recording.uri.rpartition("://")[2]).startswith(folder):
            known.setdefault(place.removeprefix(folder), recording.name)
    _add_without_ending(known)
    _add_folders(known)
    tags: dict[str, Tags] = {}
    unknown = []
    for number, given, read in _rows(path):
        name = known.get(given)
        if name is None:
            unknown.append(f"{given} (line {number})")
        elif name in tags:
            raise UsageError(f"{path}:{number}: {name} is listed twice")
        else:
            tags[name] = read()
    if unknown and not tags:
        raise UsageError(
            f"{path}: lists none of the recordings; it has {_named(unknown)}, there are "
            f"{_named(list(known))}"
        )
    without = [recording.name for recording in recordings if recording.name not in tags]
    notes = []
    if unknown:
        count = f"{len(unknown)} of {len(unknown) + len(tags)} rows"
        notes.append(f"{path}: {count} match no recording: {_named(unknown)}")
    if without:
        count = f"{len(without)} of {len(recordings)} recordings"
        notes.append(f"{path}: {count} have no row: {_named(without)}")
    return TagTable(str(path), tags, tuple(notes))


def stored_tags(path: Path, names: Sequence[str]) -> dict[str, Tags]:
    """
    Return name -> tags, of those of these recordings that a table with all earlier ones lists.

    None without such a table.

    :raises UsageError: as `read_tags`, but for recordings that are not listed, or twice.
    """
    known = {name: name for name in names}
    _add_without_ending(known)
    tags: dict[str, Tags] = {}
    for _, given, read in _rows(path) if path.is_file() else ():
        name = known.get(given)
        if name is not None and (given == name or name not in tags):
            tags[name] = read()
    return tags


def merge_tags(path: Path, tags: Mapping[str, Tags]) -> None:
    """
    Add tags of recordings to a table, instead of those that it has of them.

    :raises UsageError: the table cannot be read or written.
    """
    before = {given: read() for _, given, read in _rows(path)} if path.is_file() else {}
    if (after := before | dict(tags)) != before:
        write_tags(path, after)


def _add_without_ending(known: dict[str, str]) -> None:
    """Add the names without the endings of their files, where no other recording has them."""
    for name in list(known):
        folder, slash, last = name.rpartition("/")
        if stem := last.rpartition(".")[0]:
            known.setdefault(f"{folder}{slash}{stem}", known[name])


def _add_folders(known: dict[str, str]) -> None:
    """Add the folders of single recordings: a bag that has lost its metadata.yaml is one file."""
    within: dict[str, set[str]] = {}
    for path, name in known.items():
        if folder := path.rpartition("/")[0]:
            within.setdefault(folder, set()).add(name)
    for folder, names in within.items():
        if len(names) == 1:
            known.setdefault(folder, *names)


def _named(names: Sequence[str]) -> str:
    """Return the first names."""
    shown = ", ".join(names[:_MAX_NAMED])
    return f"{shown}, ..." if len(names) > _MAX_NAMED else shown


def _rows(path: Path | str) -> Iterator[tuple[int, str, Callable[[], Tags]]]:
    """
    Yield of each row its line number, the recording as it is given, and what reads its tags.

    :raises UsageError: as `read_tags`, as the readers of tags.
    """
    try:
        with io.StringIO(_content(path).decode("utf-8-sig"), newline="") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            names = [name.strip() for name in reader.fieldnames or ()]
            reader.fieldnames = names
            _check_columns(path, names)
            for row in reader:
                where = f"{path}:{reader.line_num}"
                if not any(x.strip() for x in row.values() if isinstance(x, str)):
                    # An empty row of a spreadsheet.
                    continue
                if len(row) != len(names) or any(value is None for value in row.values()):
                    raise UsageError(f"{where}: {len(names)} columns expected")
                given = row["recording"].strip().strip("/")
                if not given:
                    raise UsageError(f"{where}: the name of the recording is missing")
                yield reader.line_num, given, partial(_tags, where, row, names)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UsageError(f"{path} cannot be read: {reason}") from None


def _content(path: Path | str) -> bytes:
    if isinstance(path, Path):
        return path.read_bytes()
    system, place = file_system(path)
    content: bytes = with_retries(path, partial(system.cat_file, place))
    return content


def _check_columns(path: Path | str, names: Sequence[str]) -> None:
    missing = [name for name in _COLUMNS if name not in names]
    if missing:
        raise UsageError(
            f"{path}: column {', '.join(missing)} missing: needed are {', '.join(_COLUMNS)}, then "
            "any tags"
        )
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice or "" in names:
        raise UsageError(f"{path}: column {', '.join(twice) or 'without a name'} in line 1")


def _tags(where: str, row: Mapping[str, str], names: Sequence[str]) -> Tags:
    vehicle = row["vehicle"].strip()
    if not vehicle:
        raise UsageError(f"{where}: vehicle is empty: name the car of {row['recording']}")
    conditions = {name: row[name].strip() for name in names if name not in _COLUMNS}
    return Tags(vehicle, _seconds(where, row["time"].strip()), conditions)


def _seconds(where: str, text: str) -> float | None:
    if not text:
        return None
    try:
        # Python 3.10 does not know the Z.
        when = datetime.fromisoformat(text.replace("Z", "+00:00"))
    except ValueError:
        raise UsageError(
            f"{where}: time {text!r} is not ISO 8601, such as 2026-03-31T14:05:00"
        ) from None
    return (when if when.tzinfo else when.replace(tzinfo=timezone.utc)).timestamp()


def write_tags(path: Path, tags: Mapping[str, Tags]) -> None:
    """
    Write tags as `read_tags` reads them, whole or not at all.

    :raises UsageError: the file cannot be written.
    """
    names = sorted({name for each in tags.values() for name in each.conditions})
    scratch = path.with_name(f".{path.name}")
    try:
        with scratch.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([*_COLUMNS, *names])
            for recording, each in sorted(tags.items()):
                time = "" if each.time_s is None else _iso(each.time_s)
                conditions = [each.conditions.get(name, "") for name in names]
                writer.writerow([recording, each.vehicle, time, *conditions])
        os.replace(scratch, path)
    except OSError as error:
        scratch.unlink(missing_ok=True)
        raise UsageError(f"{path} cannot be written: {error.strerror or error}") from None


def _iso(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, timezone.utc).isoformat()
