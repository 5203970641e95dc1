# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a run has to do: which results exist, which are those of a copy, which are missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256

from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.recordings import FleetRecording
from adk_ros.fleet.stage import StageVersion


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
    content hash is not known yet.
    """

    done: int
    failed: int
    copied: Mapping[str, list[FleetRecording]]
    missing: Sequence[Work]
    unhashed: Sequence[FleetRecording] = field(default_factory=tuple)


def plan(
    version: StageVersion,
    recordings: Sequence[FleetRecording],
    hashes: Mapping[tuple[str, str], str],
    dataset: FleetDataset,
    retry_failed: bool = False,
) -> Plan:
    """
    Compare the recordings with the dataset.

    :param hashes: (uri, version) -> content hash.
    :param retry_failed: failed recordings count as missing.
    """
    existing = dataset.done(version.name)
    done = failed = 0
    copied: dict[str, list[FleetRecording]] = {}
    missing: dict[str, list[FleetRecording]] = {}
    unhashed, content_of = [], {}
    for recording in recordings:
        content = hashes.get((recording.uri, recording.version))
        if content is None:
            unhashed.append(recording)
            continue
        key = version.key(content)
        content_of[key] = content
        names = existing.get(key)
        if names is None or (retry_failed and any(names.values())):
            missing.setdefault(key, []).append(recording)
        elif recording.name in names:
            done += 1
            failed += bool(names[recording.name])
        else:
            copied.setdefault(key, []).append(recording)
    work = [Work(key, content_of[key], tuple(same)) for key, same in missing.items()]
    # A large recording that starts last would leave the other workers idle.
    work.sort(key=lambda each: (-each.size, each.key))
    return Plan(done, failed, copied, work, unhashed)


def unreadable_content(recording: FleetRecording) -> str:
    """Return what replaces the content hash of a recording that cannot be read."""
    return sha256(f"unreadable\n{recording.uri}\n{recording.version}".encode()).hexdigest()
