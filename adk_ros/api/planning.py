# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.adapted_predictor`: the predictor at a time of a recording, for planners."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from adk_ros.api.model import TrainedModel, as_model
from adk_ros.api.progress import Progress, in_stage
from adk_ros.api.recording import (
    BagRecording,
    as_recording,
    recording_options,
)
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import DataError, UsageError

if TYPE_CHECKING:
    from adk_ros.model.predictor import Predictor


def adapted_predictor(
    recording: BagRecording | Path | str,
    model: TrainedModel | Path | str,
    *,
    until_s: float = math.inf,
    options: RecordingOptions | None = None,
    progress: Progress | None = None,
) -> Predictor:
    """
    Return the predictor after the samples of a recording up to a time, adapted to them.

    Its `roll_out_many`, `linearized` and `roll_out_gradient` predict from there under commands of
    a planner; `step` takes further samples.

    :param recording: a recording or a bag.
    :param model: a trained model or its folder.
    :param until_s: time of the last sample, s from the bag's first message; default: all samples.
    :param options: how to read a bag; default: with the sensor configuration of the model.
    :raises UsageError: an argument is invalid, or the model cannot be read.
    :raises DataError: the recording is unusable, or the predictor has no state at that time.

    Example::

        predictor = adk_ros.adapted_predictor("bags/town", "models/handling", until_s=20.0)
        states = predictor.roll_out_many(candidates)
    """
    from adk_ros.model.evaluation import sample_at
    from adk_ros.model.predictor import Predictor

    trained = as_model(model)
    if options is None and not isinstance(recording, BagRecording):
        options = recording_options(stored_sensors=trained.sensors)
    read = as_recording(recording, options, progress)
    if not until_s >= 0.0:
        raise UsageError(f"until_s is {until_s:g}: give a time of at least 0 s")
    rows = int((read.time_s <= until_s).sum())
    report = in_stage(progress, "adapting")
    predictor = Predictor(trained.artefact.model, horizon_steps=0)
    prediction = None
    for row in range(rows):
        prediction = predictor.step(sample_at(read.record, row))
        if row % 500 == 0:
            report(row, rows)
    report(rows, rows)
    if prediction is None:
        where = f"at {until_s:g} s" if math.isfinite(until_s) else "at its end"
        raise DataError(
            f"{read.name}: the predictor has no state {where} ({predictor.status.value}): choose "
            "another time"
        )
    return predictor
