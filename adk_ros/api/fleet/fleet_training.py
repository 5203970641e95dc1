# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Train a model on the recordings of a fleet, from more data than memory holds.

The workers write each recording as a shard and list its blocks (`ShardStage`). Vehicles are held
out whole for validation and test. The training draws windows of blocks, balanced over driving
conditions and tags, of which one is in memory at a time (`fleet.training.sampling`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from adk_ros.api.fleet.fleet_run import FleetOptions, tags_file
from adk_ros.api.fleet.shard_stage import SHARDS
from adk_ros.api.fleet.training_data import (
    FleetTrainingOptions,
    fleet_training_data,
    joined_records,
    split_of,
)
from adk_ros.api.progress import Progress
from adk_ros.fleet.run import Progress as FleetProgress
from adk_ros.fleet.run_lock import run_lock

if TYPE_CHECKING:
    from adk_ros.api.model import TrainedModel
    from adk_ros.train.network_fit import Step
    from adk_ros.train.train_settings import TrainSettings


def train_fleet(
    recordings: Sequence[str],
    out: Path | str,
    model: Path | str,
    *,
    settings: TrainSettings | None = None,
    training: FleetTrainingOptions | None = None,
    options: FleetOptions | None = None,
    report: bool = True,
    force: bool = False,
    fleet_progress: FleetProgress | None = None,
    progress: Progress | None = None,
    on_step: Callable[[Step], None] | None = None,
) -> TrainedModel:
    """
    Train a model on the recordings of a fleet and score it on vehicles that it has not seen.

    An interrupted training resumes when it is called again with the same arguments.

    :param recordings: folders, globs and fsspec URLs; fleet.csv names the vehicles. A recording
        without a vehicle counts as a separate one.
    :param out: folder of the fleet's results, with the shards.
    :param model: model folder to write.
    :raises UsageError: an argument is invalid, `model` exists, `out` is in use, or fewer than
        three vehicles have data.
    :raises DataError: the data are unusable or too short.
    """
    from adk_ros.api.model import load_model
    from adk_ros.api.provenance import RunTimer
    from adk_ros.api.training import check_training, default_settings, training_callbacks
    from adk_ros.train.training_report import remove_report, write_report
    from adk_ros.train.training_run import train_on_split
    from adk_ros.train.windows import TrainingWindows

    timer = RunTimer()
    out, model = Path(out), Path(model)
    training, options = training or FleetTrainingOptions(), options or FleetOptions()
    chosen = settings or default_settings()
    check_training(model, "blocks", 1, force)
    with run_lock(out):
        data = fleet_training_data(recordings, out, chosen.seed, training, options, fleet_progress)
        folder = out / SHARDS
        drawn = data.windows
        windows = TrainingWindows(
            drawn.count, drawn.key, lambda number: joined_records(folder, drawn.window(number))
        )
        split = split_of(folder, data, windows.read(0), chosen.seed)
        stepped, noted = training_callbacks(progress, on_step)
        run = train_on_split(
            split, model, chosen, training.reading.sensors, stepped, noted, windows,
            {"fleet": data.as_dict()},
        )  # fmt: skip
        if report:
            write_report(run, model, provenance=timer.provenance(tags_file(out)))
        else:
            remove_report(model)
    return replace(load_model(model), training=run)
