# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many minutes of driving recordings have, from their sizes and some known durations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

from adk_ros.bags import Bag
from adk_ros.errors import AdkError
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.recordings import FleetRecording, local_recording
from adk_ros.fleet.store import file_system, is_local

_OPENED = 20
"""Recordings on the disk whose duration is read, a few milliseconds each. By choice."""


def recording_minutes(found: Sequence[FleetRecording], dataset: FleetDataset) -> float | None:
    """
    Return minutes of driving, None if no duration is known.

    Durations are those of 'adk fleet index', or read from the first recordings on the disk; the
    bytes of the others count at the same rate.
    """
    known = _indexed(dataset) or list(islice(_opened(found), _OPENED))
    size = sum(each for each, _ in known)
    if not size:
        return None
    return sum(each.size for each in found) * sum(s for _, s in known) / size / 60.0


def _indexed(dataset: FleetDataset) -> list[tuple[int, float]]:
    """Return bytes and seconds of the recordings that 'adk fleet index' has read."""
    rows = dataset.rows("index", {"kind": ["content"], "finding": ["duration"]})
    return [(row["bytes"], row["value"]) for row in rows]


def _opened(found: Sequence[FleetRecording]) -> Iterator[tuple[int, float]]:
    for recording in found:
        if not is_local(file_system(recording.uri)[0]):
            continue
        try:
            with local_recording(recording) as path, Bag(path) as bag:
                yield recording.size, bag.duration_s
        except AdkError:
            continue
