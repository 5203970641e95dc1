# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Open-loop predictions along a bag, by a trained model or by the 7-DoF model: `rollouts.csv`.

From every start, the prediction under the bag's own commands. Measurements up to the start may be
used, none after it: a trained model adapts up to each start, the 7-DoF model starts from the
sample alone.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from adk_ros.drives import DriveOptions, read_drive
from adk_ros.errors import DataError, UsageError
from adk_ros.model import artefact
from adk_ros.model.evaluate import sample_at
from adk_ros.model.predictor import Predictor
from adk_ros.plant.params import load_vehicle
from adk_ros.plant.rollout import rollout as seven_dof_rollout
from adk_ros.signals.channels import TICK_NS, BoolArray, FloatArray, IntArray, Record

FIRST_START_S = 2.0
_TICK_S = TICK_NS * 1e-9

Progress = Callable[[int, int], None]


def roll_out_bag(
    model: Path,
    bag: Path,
    horizon_s: float,
    stride_s: float,
    options: DriveOptions,
    progress: Progress | None = None,
) -> tuple[FloatArray, FloatArray]:
    """
    Return starts (n,), seconds from the bag's first message, and predictions (n, h, 3) in SI.

    `model`: an artefact folder or a vehicle YAML. Entry j of a prediction is j + 1 ticks ahead.
    :raises UsageError: horizon or stride out of range, or the model is none.
    :raises DataError: no start has a state and known commands over the horizon.
    """
    if not _TICK_S <= horizon_s <= 10.0:
        raise UsageError(f"--horizon {horizon_s:g} is out of range: choose 0.025 to 10 s")
    if not stride_s >= _TICK_S:
        raise UsageError(f"--stride {stride_s:g} is too small: at least 0.025 s")
    steps = round(horizon_s / _TICK_S)
    drive = read_drive(bag, options, progress)
    record = drive.record
    since_s = (record.stamp_ns - drive.start_ns) * 1e-9
    rows = start_rows(record, since_s, steps, stride_s)
    if rows.size == 0:
        raise DataError(f"{bag}: no start has commands known for {horizon_s:g} s after it")
    if model.is_dir():
        kept, predicted = _by_model(model, record, rows, steps, progress)
    elif model.is_file():
        commands = record.u[rows[:, None] + np.arange(steps)]
        kept = np.ones(rows.size, dtype=bool)
        predicted = seven_dof_rollout(load_vehicle(model), record.x[rows], commands)
    else:
        raise UsageError(f"model {model} does not exist: give a model folder or a vehicle YAML")
    if not kept.any():
        raise DataError(f"{bag}: the model could not predict from any start")
    return since_s[rows[kept]], predicted


def start_rows(
    record: Record, since_s: FloatArray, steps: int, stride_s: float
) -> IntArray:
    """Rows (n,) to start from: every `stride_s` after the first 2 s, state and commands known."""
    wanted = np.arange(FIRST_START_S, since_s[-1] + 1e-9, stride_s)
    rows = np.unique(np.searchsorted(since_s, wanted - 1e-6))
    rows = rows[rows + steps < len(record)]
    known: BoolArray = np.isfinite(record.x).all(axis=1)
    commanded = np.concatenate([[0], np.cumsum(~np.isfinite(record.u).all(axis=1))])
    usable = known[rows] & (commanded[rows + steps] == commanded[rows])
    usable &= record.episode[rows] == record.episode[np.minimum(rows + steps, len(record) - 1)]
    return rows[usable].astype(np.int64)


def _by_model(
    model: Path, record: Record, rows: IntArray, steps: int, progress: Progress | None
) -> tuple[BoolArray, FloatArray]:
    predictor = Predictor(artefact.load(model).model, horizon_steps=0)
    position = {int(row): i for i, row in enumerate(rows)}
    kept = np.zeros(rows.size, dtype=bool)
    predicted = []
    last = int(rows[-1])
    for row in range(last + 1):
        made = predictor.step(sample_at(record, row))
        if progress is not None and row % 500 == 0:
            progress(row, last + 1)
        if row in position and made is not None:
            kept[position[row]] = True
            predicted.append(predictor.roll_out(record.u[row : row + steps]))
    return kept, np.array(predicted).reshape(-1, steps, 3)


def write_csv(out: Path, starts_s: FloatArray, predicted: FloatArray) -> None:
    """
    Write `start_s,t_s,v_x,v_y,yaw_rate` rows, as one whole file or none.

    :raises UsageError: the file cannot be written.
    """
    part = out.with_name(out.name + ".part")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with part.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["start_s", "t_s", "v_x", "v_y", "yaw_rate"])
            for start, states in zip(starts_s, predicted, strict=True):
                for step, x in enumerate(states, start=1):
                    time_s = start + step * _TICK_S
                    writer.writerow([f"{start:.6f}", f"{time_s:.6f}", *(f"{v:.9g}" for v in x)])
        os.replace(part, out)
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror}") from None
