# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Find recordings in folders, globs and URLs."""

from __future__ import annotations

import glob
import hashlib
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from adk_ros.errors import UsageError
from adk_ros.fleet.local_files import described, local_files
from adk_ros.fleet.store import file_system, is_local, with_retries

_STORAGE = (".mcap", ".db3", ".bag", ".mcap.zstd", ".db3.zstd")
_METADATA = "metadata.yaml"
_BLOCK_BYTES = 1 << 20


class RecordingChanged(UsageError):
    """A recording is not the one that was listed any more: what was read belongs to no content."""


@dataclass(frozen=True)
class FleetRecording:
    """
    A recording of the fleet.

    `name`: path below the folder in which it was found; `uri`: where it is; `files`: its files, as
    paths in their file system, sorted. `size` in bytes. `version`: changes if a file changes, from
    sizes and times of change (or entity tags): as long as it is the same, the content hash is.
    `entity_tags`: of each file in a store, "" where it gives none.
    """

    name: str
    uri: str
    files: tuple[str, ...]
    size: int
    version: str
    entity_tags: tuple[str, ...] = ()


def find_recordings(given: Sequence[str]) -> list[FleetRecording]:
    """
    Return the recordings in folders, globs and URLs, sorted by name, each once.

    A recording is a folder with metadata.yaml; the files FOLDER_0, FOLDER_1, ... of a folder
    without one; or any other .mcap, .db3 or .bag file. On the disk, links are followed.

    :raises UsageError: nothing matches, no recording is there, a folder cannot be read, or the
        name of a recording is not UTF-8.
    :raises StoreUnreachable: a store does not answer.
    """
    found: dict[str, FleetRecording] = {}
    for uri in given:
        listed = list(_below(uri))
        found = {recording.uri: recording for recording in listed} | found
        if not listed:
            raise UsageError(f"{uri}: no recording (.mcap, .db3, .bag or rosbag2 folder) there")
    by_name: dict[str, FleetRecording] = {}
    for recording in found.values():
        _check_names(recording)
        if (other := by_name.get(recording.name)) is not None:
            raise UsageError(
                f"{other.uri} and {recording.uri} are both named {recording.name}: give the "
                "folder above them"
            )
        by_name[recording.name] = recording
    return sorted(by_name.values(), key=lambda recording: recording.name)


def _check_names(recording: FleetRecording) -> None:
    """:raises UsageError: a path cannot be written as text, as the results and Dask need it."""
    for path in recording.files:
        try:
            path.encode()
        except UnicodeEncodeError:
            raise UsageError(f"{path}: its name is not UTF-8: rename it") from None


def _below(uri: str) -> Iterator[FleetRecording]:
    system, path = file_system(uri)
    is_disk = is_local(system)

    def listed() -> list[tuple[str, dict[str, Any]]]:
        system.invalidate_cache()
        roots = [path]
        if any(mark in path for mark in "*?["):
            roots = sorted(_matches(path) if is_disk else system.glob(path))
        result = []
        for root in roots:
            if not system.exists(root):
                raise FileNotFoundError(root)
            parent = root if roots == [path] and not _is_bag(system, root) else _parent(root)
            infos = (
                local_files(root, _is_of_recording)
                if is_disk
                else system.find(root, detail=True).values()
            )
            result += [(parent, info) for info in infos]
        return result

    try:
        files = with_retries(uri, listed)
    except OSError as error:
        is_absent = isinstance(error, FileNotFoundError)
        reason = "does not exist" if is_absent else f"cannot be read: {error.strerror or error}"
        raise UsageError(f"{uri} {reason}") from None
    folders: dict[str, list[tuple[str, dict[str, Any]]]] = {}
    for parent, info in files:
        if "/." not in info["name"].removeprefix(parent):
            folders.setdefault(_parent(info["name"]), []).append((parent, info))
    prefix = "" if is_disk else f"{uri.partition('://')[0]}://"
    for folder, content in folders.items():
        yield from _in_folder(folder, content, prefix)


def _matches(pattern: str) -> Iterator[str]:
    """Return what matches a pattern on the disk, also behind links, unlike the glob of fsspec."""
    return (path.rstrip("/") for path in glob.iglob(pattern, recursive=True))


def _is_of_recording(name: str) -> bool:
    return name == _METADATA or name.endswith(_STORAGE)


def _in_folder(
    folder: str, content: list[tuple[str, dict[str, Any]]], prefix: str
) -> Iterator[FleetRecording]:
    parent = content[0][0]
    infos = {info["name"]: info for _, info in content}
    stored = [name for name in infos if name.endswith(_STORAGE)]
    if f"{folder}/{_METADATA}" in infos:
        groups = {folder: [*stored, f"{folder}/{_METADATA}"]}
    else:
        part = re.compile(re.escape(PurePosixPath(folder).name) + r"_\d+\.")
        parts = [name for name in stored if part.match(PurePosixPath(name).name)]
        groups = {folder: parts} if parts and folder != parent else {}
        rest = [name for name in stored if not groups or name not in parts]
        groups |= {name: [name] for name in rest}
    for path, names in groups.items():
        name = path.removeprefix(parent).strip("/") or PurePosixPath(path).name
        files = tuple(sorted(names))
        yield FleetRecording(
            name,
            prefix + path,
            files,
            sum(infos[name]["size"] for name in files),
            _version(infos[name] for name in files),
            tuple(_entity_tag(infos[name]) for name in files),
        )


def _version(infos: Iterable[dict[str, Any]]) -> str:
    versions = [(info["name"], info["size"], _changed(info)) for info in infos]
    return hashlib.sha256(repr(versions).encode()).hexdigest()


def check_unchanged(recording: FleetRecording) -> None:
    """
    Check that the files on the disk are still those that were listed.

    One that is still being written would have results that belong to no content. Objects of a
    store are checked when they are read (`_check_stored`).

    :raises RecordingChanged: they are not.
    """
    system, _ = file_system(recording.uri)
    if not is_local(system):
        return
    try:
        is_same = _version(map(described, recording.files)) == recording.version
    except OSError:
        is_same = False
    if not is_same:
        raise _changed_recording(recording)


def _check_stored(system: Any, recording: FleetRecording) -> None:
    """
    Check that the objects of a store, which have just been read, are those that were listed.

    :raises RecordingChanged: they are not. :raises StoreUnreachable: the store does not answer.
    """
    try:
        is_same = with_retries(recording.uri, partial(_is_stored, system, recording))
    except FileNotFoundError:
        is_same = False
    if not is_same:
        raise _changed_recording(recording)


def _changed_recording(recording: FleetRecording) -> RecordingChanged:
    return RecordingChanged(
        f"{recording.uri} has changed while it was read: run the same command again when it is "
        "complete"
    )


def _is_stored(system: Any, recording: FleetRecording) -> bool:
    """Whether the objects of a store are those that were listed, by size and entity tag."""
    system.invalidate_cache()
    infos = [system.info(name) for name in recording.files]
    # A store may list times in another form than it gives them for an object.
    tags = zip(map(_entity_tag, infos), recording.entity_tags, strict=False)
    is_same_size = sum(info["size"] for info in infos) == recording.size
    return is_same_size and all(now == before for now, before in tags if now and before)


def _changed(info: dict[str, Any]) -> str:
    """Return what changes with the content of a file: entity tag or time of change."""
    for key in ("ETag", "etag", "mtime", "LastModified", "last_modified", "created"):
        if info.get(key) is not None:
            return str(info[key])
    return ""


def _entity_tag(info: dict[str, Any]) -> str:
    """Return the entity tag of an object without quotes, "" for none."""
    return str(info.get("ETag") or info.get("etag") or "").strip('"')


def _is_bag(system: Any, path: str) -> bool:
    return bool(system.isfile(path) or system.exists(f"{path}/{_METADATA}"))


def _parent(path: str) -> str:
    return path.rstrip("/").rpartition("/")[0]


def content_hash(recording: FleetRecording) -> str:
    """
    Return the hash of a recording's content (64 hexadecimal digits).

    Of names, sizes and contents of the files; the name of the recording itself does not count, so
    a copy or a moved recording has the same hash.

    :raises UsageError: a file cannot be read, or has changed since it was listed.
    :raises StoreUnreachable: a store does not answer.
    """
    system, _ = file_system(recording.uri)

    def read() -> str:
        digest = hashlib.sha256()
        for path in recording.files:
            name = "" if len(recording.files) == 1 else PurePosixPath(path).name
            digest.update(f"{name}\0".encode())
            with system.open(path, "rb") as file:
                while block := file.read(_BLOCK_BYTES):
                    digest.update(block)
        return digest.hexdigest()

    try:
        content = with_retries(recording.uri, read)
    except OSError as error:
        raise UsageError(f"{recording.uri} cannot be read: {error.strerror or error}") from None
    if is_local(system):
        check_unchanged(recording)
    else:
        _check_stored(system, recording)
    return content


def _copy_file(system: Any, name: str, copy: Path) -> None:
    """
    Copy a file of an object store to the disk.

    :raises ConnectionError: fewer bytes have arrived than the store has.
    """
    system.get_file(name, str(copy))
    system.invalidate_cache()
    size, stored = copy.stat().st_size, system.size(name)
    if size != stored:
        raise ConnectionError(f"{size} of {stored} bytes of {name} have arrived")


@contextmanager
def local_recording(recording: FleetRecording) -> Iterator[Path]:
    """
    Yield the path of a recording on the disk; one of an object store is copied and removed again.

    :raises UsageError: it cannot be read. :raises RecordingChanged: an object is gone.
    :raises StoreUnreachable: the store does not answer.
    """
    system, path = file_system(recording.uri)
    if is_local(system):
        yield Path(path)
        return
    folder = Path(tempfile.mkdtemp(prefix="adk_fleet_"))
    try:
        is_file = recording.files == (path,)
        target = folder if is_file else folder / PurePosixPath(path).name
        target.mkdir(exist_ok=True)
        for name in recording.files:
            copy = target / PurePosixPath(name).name
            with_retries(recording.uri, partial(_copy_file, system, name, copy))
        # The copy stays as it is: later, a store that does not answer costs no result.
        _check_stored(system, recording)
        yield copy if is_file else target
    except FileNotFoundError:
        raise RecordingChanged(
            f"{recording.uri}: a file has been removed from the store"
        ) from None
    finally:
        shutil.rmtree(folder, ignore_errors=True)
