# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The archive of a TorchScript program: its entries, bounded and known by name, and written anew.

PyTorch reads archives with a zip library of its own, which may find other entries in the same
bytes than Python's does. It is therefore given an archive written from the entries that were
checked. Debug information, which PyTorch would read on an error, is left out.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import PurePosixPath
from typing import NamedTuple

from adk_ros.errors import UsageError

MAX_PROGRAM_BYTES = 16 << 20
"""Bytes of encoder.pt: that of the default model has 20 kB."""
_MAX_UNPACKED_BYTES = 64 << 20
_MAX_ENTRIES = 500
_MAX_CODE_BYTES = 256 << 10
TRUST = "load only models that you trust, or train one"

_FOLDER = "archive"
_BYTE_ORDER = b"little"
_KNOWN = {"data.pkl", "constants.pkl", "version", "byteorder", ".data/serialization_id"}


class ProgramEntries(NamedTuple):
    """Code by module name, and storages of tensors by key; `version` of the file format."""

    sources: dict[str, str]
    data: bytes
    constants: bytes
    storages: dict[str, bytes]
    version: int


def read_entries(program: bytes) -> ProgramEntries:
    """
    Return the entries of a program.

    :raises UsageError: it is too large, no TorchScript archive, or has entries of other kinds.
    """
    if len(program) > MAX_PROGRAM_BYTES:
        raise UsageError(
            f"the encoder has {len(program) >> 20} MiB: at most {MAX_PROGRAM_BYTES >> 20} MiB"
        )
    try:
        with zipfile.ZipFile(io.BytesIO(program)) as archive:
            return _entries(archive)
    except UsageError:
        raise
    except Exception as error:
        # zipfile and the decompressors raise a dozen types on damaged archives.
        raise unreadable(error) from None


def unreadable(error: Exception) -> UsageError:
    """Return the error for a program that cannot be parsed."""
    reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
    return UsageError(f"the encoder is not a readable TorchScript program: {reason}")


def _entries(archive: zipfile.ZipFile) -> ProgramEntries:
    found = archive.infolist()
    names = [entry.filename for entry in found]
    if len(names) > _MAX_ENTRIES or len(set(names)) < len(names):
        raise ValueError("it has too many or repeated entries")
    if sum(entry.file_size for entry in found) > _MAX_UNPACKED_BYTES:
        raise UsageError(
            f"the encoder unpacks to more than {_MAX_UNPACKED_BYTES >> 20} MiB: {TRUST}"
        )
    content: dict[str, bytes] = {}
    for entry in found:
        _, _, path = entry.filename.partition("/")
        if path in content:
            raise ValueError(f"entry '{path}' is repeated")
        if not path.endswith(".py.debug_pkl"):
            content[path] = archive.read(entry)
    for path in ("data.pkl", "constants.pkl", "version"):
        if path not in content:
            raise ValueError(f"entry '{path}' is missing")
    sources, storages = {}, {}
    for path in sorted(set(content) - _KNOWN):
        place = PurePosixPath(path)
        if place.parts[:1] == ("code",) and place.suffix == ".py":
            if len(content[path]) > _MAX_CODE_BYTES:
                raise ValueError(f"entry '{path}' is too long")
            sources[".".join(place.with_suffix("").parts[1:])] = content[path].decode()
        elif place.parts[:1] == ("data",) and place.name.isdecimal() and len(place.parts) == 2:
            storages[place.name] = content[path]
        else:
            raise ValueError(f"entry '{path}' is unknown")
    if not sources:
        raise ValueError("it contains no code")
    if content.get("byteorder", _BYTE_ORDER) != _BYTE_ORDER:
        raise ValueError("its numbers are not little-endian")
    return ProgramEntries(
        sources, content["data.pkl"], content["constants.pkl"], storages,
        int(content["version"]),
    )  # fmt: skip


def write_archive(entries: ProgramEntries) -> bytes:
    """Return an archive of checked entries."""
    content: dict[str, bytes] = {
        "data.pkl": entries.data,
        "constants.pkl": entries.constants,
        "version": b"%d\n" % entries.version,
        "byteorder": _BYTE_ORDER,
    }
    content |= {f"data/{key}": storage for key, storage in entries.storages.items()}
    for module, source in entries.sources.items():
        content[f"code/{module.replace('.', '/')}.py"] = source.encode()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for path, stored in content.items():
            archive.writestr(f"{_FOLDER}/{path}", stored)
    return buffer.getvalue()
