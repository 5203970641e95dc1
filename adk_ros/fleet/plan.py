# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a run has to do: which results exist, which are those of a copy, which are missing.

And which rows of the dataset are those of recordings as they are now.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any

from adk_ros.fleet.dataset import UNREADABLE, FleetDataset
from adk_ros.fleet.recordings import FleetRecording
from adk_ros.fleet.stage import StageVersion
from adk_ros.fleet.stage_process import Failure

CHANGED = Failure.CHANGED.value


@dataclass(frozen=True)
class Work:
    """A result to compute: `key`, and the `recordings` of this content, of which one is read."""

    key: str
    content_hash: str
    recordings: tuple[FleetRecording, ...]

    @property
    def size(self) -> int:
        """Bytes of the recording."""
        return self.recordings[0].size


@dataclass(frozen=True)
class Plan:
    """
    What is done, and what is left.

    `done`: recordings with a result. `copied`: recordings whose content has a result under another
    name, by key. `missing`: what to compute, large recordings first. `unhashed`: recordings whose
    content hash is not known yet. `replaced`: keys of `missing` whose old rows are replaced.
    """

    done: int
    failed: int
    copied: Mapping[str, list[FleetRecording]]
    missing: Sequence[Work]
    unhashed: Sequence[FleetRecording] = field(default_factory=tuple)
    replaced: frozenset[str] = frozenset()

    def to_hash(self, count: int | None) -> Sequence[FleetRecording]:
        """Return the recordings to hash if at most `count` are processed, the largest first."""
        if count is None:
            return self.unhashed
        largest = sorted(self.unhashed, key=lambda each: (-each.size, each.name))
        return largest[: max(count - len(self.missing), 0)]


def plan(
    version: StageVersion,
    recordings: Sequence[FleetRecording],
    hashes: Mapping[tuple[str, str], str],
    dataset: FleetDataset,
    retry_failed: bool = False,
) -> Plan:
    """
    Compare the recordings with the dataset.

    A recording that changed or was moved while it was read has no result.

    :param hashes: (uri, version) -> content hash.
    :param retry_failed: failed recordings count as missing.
    """
    existing = dataset.done(version.name)
    keys = current_keys(version, recordings, hashes)
    done = failed = 0
    copied: dict[str, list[FleetRecording]] = {}
    missing: dict[str, list[FleetRecording]] = {}
    unhashed, content_of = [], {}
    for recording in recordings:
        key = keys.get(recording.name)
        if key is None:
            unhashed.append(recording)
            continue
        content_of[key] = hashes[recording.uri, recording.version]
        names = existing.get(key)
        failed_as = set(names.values()) if names else set()
        if names is None or CHANGED in failed_as or (retry_failed and any(failed_as)):
            missing.setdefault(key, []).append(recording)
        elif recording.name in names:
            done += 1
            failed += bool(names[recording.name])
        else:
            copied.setdefault(key, []).append(recording)
    work = [Work(key, content_of[key], tuple(same)) for key, same in missing.items()]
    # A large recording that starts last would leave the other workers idle.
    work.sort(key=lambda each: (-each.size, each.key))
    return Plan(done, failed, copied, work, unhashed, frozenset(existing.keys() & missing.keys()))


def current_keys(
    version: StageVersion,
    recordings: Sequence[FleetRecording],
    hashes: Mapping[tuple[str, str], str],
) -> dict[str, str]:
    """Return name of recording -> key of its result, of those whose content hash is known."""
    return {
        each.name: version.key(hashes[each.uri, each.version], each.name)
        for each in recordings
        if (each.uri, each.version) in hashes
    }


def current_rows(
    version: StageVersion,
    recordings: Sequence[FleetRecording],
    dataset: FleetDataset,
    where: Mapping[str, Collection[str]] | None = None,
) -> list[dict[str, Any]]:
    """
    Return the rows of recordings as they are listed: of their present content, with this version.

    :param where: as in `FleetDataset.rows`.
    """
    keys = current_keys(version, recordings, dataset.content_hashes())
    return rows_of(keys, version.name, dataset, where)


def rows_of(
    keys: Mapping[str, str],
    stage: str,
    dataset: FleetDataset,
    where: Mapping[str, Collection[str]] | None = None,
) -> list[dict[str, Any]]:
    """
    Return the rows of a stage with the key that each recording has, by name.

    :param where: as in `FleetDataset.rows`.
    """
    wanted = {"key": set(keys.values()), "recording": keys.keys()}
    rows = dataset.rows(stage, {**wanted, **(where or {})})
    # A recording may have had the content that another one has now.
    return [row for row in rows if row["key"] == keys[row["recording"]]]


def distinct_rows(
    rows: Iterable[dict[str, Any]], content: Callable[[dict[str, Any]], str]
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """
    Return the rows of usable recordings, sorted by name, and name -> reason of the others.

    A copy under another name is no further data: of each `content` the first by name is used.
    """
    used, left_out = [], {}
    first_of: dict[str, str] = {}
    for row in sorted(rows, key=lambda row: str(row["recording"])):
        name = str(row["recording"])
        if row["status"] != "ok":
            left_out[name] = str(row["reason"])
        elif (first := first_of.setdefault(content(row), name)) != name:
            left_out[name] = f"has the content of {first}"
        else:
            used.append(row)
    return used, left_out


def content_of(row: dict[str, Any]) -> str:
    """Return the content hash of a row."""
    return str(row["content_hash"])


def unreadable_content(recording: FleetRecording) -> str:
    """Return what replaces the content hash of a recording that cannot be read."""
    return UNREADABLE + sha256(f"{recording.uri}\n{recording.version}".encode()).hexdigest()
