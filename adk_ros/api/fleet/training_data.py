# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a model is trained, validated and tested on: shards of a fleet, by vehicle."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.api.fleet.fleet_run import FleetOptions, listed_recordings, run_fleet
from adk_ros.api.fleet.lost_files import forget_lost_files
from adk_ros.api.fleet.shard_stage import SHARDS, ShardStage
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import UsageError
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.plan import current_rows, distinct_rows
from adk_ros.fleet.recordings import FleetRecording
from adk_ros.fleet.run import Progress
from adk_ros.fleet.stage import version_of
from adk_ros.fleet.tags import Tags
from adk_ros.fleet.training.sampling import (
    BlockWindows,
    FleetBlock,
    VehicleSplit,
    split_vehicles,
)
from adk_ros.fleet.training.shards import read_rows
from adk_ros.signals.channels import TICK_NS, Record
from adk_ros.train.dataset import TEST, TRAIN, VALIDATION, VEHICLES, Split

_MAX_TAG_VALUES = 4
"""Columns of fleet.csv with more values are not balanced: with names of routes or drivers, every
recording would be a condition. By choice."""
_VALIDATION_SLICES, _SLICE_S = 8, 100.0
"""Contiguous parts of the validating vehicles' recordings, for 45 candidates of hyperparameters:
800 s take 3 to 5 min. The adaptation's window is 50 s."""
_TEST_S = 3600.0
"""s of recordings of the testing vehicles that are scored; 'adk fleet replay' scores all."""


@dataclass(frozen=True)
class FleetTrainingOptions:
    """
    How a model is trained on a fleet.

    `window_s`: s of driving in memory at a time. `balanced`: equal shares of driving conditions
    and tags. `validation`, `test`: vehicles to hold out, () for a tenth and a fifth of them.
    `reading`: topics and sensors of all recordings.
    """

    window_s: float = 3600.0
    balanced: bool = True
    validation: tuple[str, ...] = ()
    test: tuple[str, ...] = ()
    reading: RecordingOptions = field(default_factory=RecordingOptions)

    def __post_init__(self) -> None:
        """:raises UsageError: a value is out of range."""
        if not 60.0 <= self.window_s < math.inf:
            raise UsageError(f"{self.window_s / 3600.0:g} h in memory: choose at least a minute")


@dataclass(frozen=True)
class FleetTrainingData:
    """
    What a training draws from.

    `windows`: of the training vehicles' blocks; `validation`, `test`: blocks of the others.
    `hours` of training; `failed`: recording -> why it is not used; `notes`: what does not match in
    fleet.csv.
    """

    split: VehicleSplit
    windows: BlockWindows
    validation: tuple[FleetBlock, ...]
    test: tuple[FleetBlock, ...]
    hours: float
    failed: Mapping[str, str]
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return what trained, validated and tested, for the manifest."""
        conditions = self.windows.shares()
        return {
            "vehicles": {
                "train": list(self.split.train),
                "validation": list(self.split.validation),
                "test": list(self.split.test),
            },
            "training_hours": round(self.hours, 3),
            "windows": self.windows.count,
            "conditions": {
                name: {"share": round(share, 4), "drawn": round(drawn, 4)}
                for name, (share, drawn) in conditions.items()
            },
            "recordings_not_used": dict(sorted(self.failed.items())),
            "notes": list(self.notes),
        }


def shard_stage(out: Path | str, training: FleetTrainingOptions) -> ShardStage:
    """Return the stage that writes the shards of a fleet."""
    return ShardStage(str((Path(out) / SHARDS).resolve()), training.reading)


def fleet_training_data(
    recordings: Sequence[str],
    out: Path,
    seed: int,
    training: FleetTrainingOptions,
    options: FleetOptions,
    progress: Progress | None = None,
) -> FleetTrainingData:
    """
    Write the shards that are missing, and choose what trains, validates and tests.

    :param out: seen by all workers under this path.
    :raises UsageError: as `train_fleet`.
    """
    stage = shard_stage(out, training)
    try:
        Path(stage.folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror or error}") from None
    forget_lost_files(out, SHARDS, out / SHARDS, "shard")
    run_fleet(stage, recordings, out, options, progress)
    found, table = listed_recordings(recordings, options)
    blocks, failed = _blocks(out, stage, found, table.tags)
    split = split_vehicles({b.vehicle for b in blocks}, seed, training.validation, training.test)
    parts = [
        [block for block in blocks if block.vehicle in vehicles]
        for vehicles in (split.train, split.validation, split.test)
    ]
    windows = BlockWindows(parts[0], training.window_s, seed, training.balanced)
    hours = sum(block.seconds for block in parts[0]) / 3600.0
    return FleetTrainingData(
        split, windows, tuple(parts[1]), tuple(parts[2]), hours, failed, table.notes
    )


def _blocks(
    out: Path, stage: ShardStage, recordings: Sequence[FleetRecording], tags: Mapping[str, Tags]
) -> tuple[list[FleetBlock], dict[str, str]]:
    """Return the blocks of the recordings, and recording -> why it is not used."""
    balanced = _balanced_tags(tags)
    blocks = []
    rows = current_rows(version_of(stage), recordings, FleetDataset(out))
    # A copy could train and test at once, also one in another format, of the same samples.
    used, failed = distinct_rows(
        (row for row in rows if row["status"] != "ok" or row["kind"] == "block"),
        lambda row: str(json.loads(row["details"])["shard"]),
    )
    for row in used:
        name = str(row["recording"])
        details = json.loads(row["details"])
        tagged = tags.get(name, Tags())
        values = [f"{key} {tagged.conditions.get(key, '')}" for key in balanced]
        blocks.append(
            FleetBlock(
                name,
                tagged.vehicle or name,
                details["shard"],
                int(details["start"]),
                int(details["stop"]),
                "; ".join([row["condition"], *values]),
                float(row["value"]),
                tuple(details["estimated"]),
            )
        )
    blocks.sort(key=lambda block: (block.recording, block.start))
    return blocks, failed


def _balanced_tags(tags: Mapping[str, Tags]) -> list[str]:
    """Return the columns of fleet.csv that have few values."""
    values: dict[str, set[str]] = {}
    for each in tags.values():
        for name, value in each.conditions.items():
            values.setdefault(name, set()).add(value)
    return sorted(name for name, found in values.items() if 1 < len(found) <= _MAX_TAG_VALUES)


def joined_records(folder: Path, blocks: Sequence[FleetBlock]) -> list[Record]:
    """Return blocks as records; neighbouring ones of a shard are one record."""
    runs: list[list[FleetBlock]] = []
    for block in blocks:
        last = runs[-1][-1] if runs else None
        if last is not None and (last.shard, last.stop) == (block.shard, block.start):
            runs[-1].append(block)
        else:
            runs.append([block])
    return [
        read_rows(
            folder / run[0].shard, run[0].start, run[-1].stop, run[0].recording, run[0].estimated
        )
        for run in runs
    ]


def split_of(folder: Path, data: FleetTrainingData, train: list[Record], seed: int) -> Split:
    """Return the first window, parts of validating and whole recordings of testing vehicles."""
    random = np.random.default_rng((seed, VALIDATION))
    validation = joined_records(folder, _slices(data.validation, random))
    test, total = [], 0.0
    whole = _by_recording(data.test)
    for name in random.permutation(sorted(whole)):
        if total >= _TEST_S:
            break
        run = whole[str(name)]
        test.append(
            read_rows(
                folder / run[0].shard, run[0].start, run[-1].stop, run[0].recording,
                run[0].estimated,
            )
        )  # fmt: skip
        total += test[-1].duration_s
    records, parts = [], []
    for part, chosen in ((TRAIN, train), (VALIDATION, validation), (TEST, test)):
        records += chosen
        parts += [np.full(len(record), part, dtype=np.int64) for record in chosen]
    return Split(records, parts, VEHICLES)


def _by_recording(blocks: Iterable[FleetBlock]) -> dict[str, list[FleetBlock]]:
    grouped: dict[str, list[FleetBlock]] = {}
    for block in blocks:
        grouped.setdefault(block.recording, []).append(block)
    return grouped


def _slices(blocks: Sequence[FleetBlock], random: np.random.Generator) -> list[FleetBlock]:
    """Return contiguous blocks of recordings, in turn from each vehicle, no block twice."""
    slices: dict[str, list[list[FleetBlock]]] = {}
    for run in _by_recording(blocks).values():
        size = max(1, round(_SLICE_S / (TICK_NS * 1e-9) / (run[0].stop - run[0].start)))
        cut = [run[i : i + size] for i in range(0, len(run), size)]
        slices.setdefault(run[0].vehicle, []).extend(cut)
    queues = [
        [cuts[i] for i in random.permutation(len(cuts))] for _, cuts in sorted(slices.items())
    ]
    chosen: list[list[FleetBlock]] = []
    while len(chosen) < _VALIDATION_SLICES and any(queues):
        chosen += [queue.pop() for queue in queues if queue]
    taken = [block for cut in chosen[:_VALIDATION_SLICES] for block in cut]
    return sorted(taken, key=lambda block: (block.shard, block.start))
