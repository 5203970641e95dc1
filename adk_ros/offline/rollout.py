# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Open-loop predictions along a bag, by a trained model or a physics model: `rollouts.csv`.

Each prediction uses the bag's commands over its horizon, and measurements up to its start only.
A trained model adapts up to each start. A 7-DoF model starts from the sample at the start, with
the actuator states that the earlier commands give.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from adk_ros.bags.recording import Recording, RecordingOptions
from adk_ros.errors import DataError, UsageError
from adk_ros.mismatch.deployment.open_loop import OpenLoopPredictor
from adk_ros.mismatch.deployment.prediction_starts import FIRST_START_S, start_times_of
from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.model.evaluation import sample_at
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.identification.identify_vehicle import actuator_state_history
from adk_ros.plant.identification.vehicle_rollout import rollout as seven_dof_rollout
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle, vehicles
from adk_ros.signals.channels import TICK_NS, Reading, Record

MAX_HORIZON_S = 10.0
"""s; longest horizon, the upper limit of the node's parameter `horizon_s`."""
MAX_STRIDE_S = 3600.0
"""s; longest time between starts."""
_TICK_S = TICK_NS * 1e-9

Progress = Callable[[int, int], None]


def horizon_steps(horizon_s: float, stride_s: float) -> int:
    """
    Return the number of 25 ms steps in a horizon.

    :raises UsageError: horizon or stride out of range.
    """
    if not _TICK_S <= horizon_s <= MAX_HORIZON_S:
        raise UsageError(
            f"--horizon {horizon_s:g} is out of range: choose 0.025 to {MAX_HORIZON_S:g} s"
        )
    if not _TICK_S <= stride_s <= MAX_STRIDE_S:
        raise UsageError(
            f"--stride {stride_s:g} is out of range: choose 0.025 to {MAX_STRIDE_S:g} s"
        )
    return round(horizon_s / _TICK_S)


def find_vehicle(source: Path) -> Vehicle:
    """
    Load a vehicle from a YAML file, or a vehicle of the package by its name.

    :raises UsageError: it is neither, or the file does not describe a vehicle.
    """
    if source.is_file() or str(source) in vehicles():
        return load_vehicle(source)
    raise UsageError(
        f"model {source} does not exist: give a model folder written by 'adk train', a vehicle's "
        f"YAML or one of: {', '.join(vehicles())}"
    )


def rollout(
    model: KoopmanModel | Vehicle,
    recording: Recording,
    steps: int,
    stride_s: float,
    progress: Progress | None = None,
) -> tuple[FloatArray, FloatArray]:
    """
    Return start times (n,), s from the bag's first message, and predictions (n, steps, 3) in SI.

    Entry j of a prediction is j + 1 steps after its start.

    :raises DataError: no start has a state and commands over the whole horizon.
    """
    record = recording.record
    since_s = np.asarray((record.stamp_ns - recording.start_ns) * 1e-9, dtype=np.float64)
    rows = start_rows(record, since_s, steps, stride_s)
    if rows.size == 0:
        raise DataError(
            f"{record.name}: no start after {FIRST_START_S:g} s has commands for "
            f"{steps * _TICK_S:g} s: give a longer bag, or a shorter --horizon"
        )
    if isinstance(model, KoopmanModel):
        rows, predicted = _by_trained_model(model, record, rows, steps, progress)
    else:
        u = mean_commands(record, recording.commands)
        predicted = seven_dof_rollout(
            model,
            record.x[rows],
            u[rows[:, None] + np.arange(steps)],
            actuators=actuator_state_history(model, record, u)[rows],
        )
    if rows.size == 0:
        raise DataError(f"{record.name}: the model could not predict from any start")
    return since_s[rows], predicted


def rollout_surrogate(
    model: Path,
    bag: Path,
    options: RecordingOptions,
    steps: int,
    stride_s: float,
    progress: Progress | None = None,
) -> tuple[FloatArray, FloatArray, SensorLog]:
    """
    Return start times and predictions as `rollout` does, by a surrogate of `adk mismatch`.

    The third is the recording as the surrogate reads it.

    :raises UsageError: the file or the bag cannot be read.
    :raises DataError: the bag lacks a stream, or there is no start.
    """
    surrogate = load_surrogate(model)
    recording = read_sensor_log(bag, options, progress, needs_imu=False)
    starts = start_times_of(recording, steps, stride_s, FIRST_START_S)
    predicted = OpenLoopPredictor(surrogate.content, recording).predict(starts, steps)
    return starts, predicted, recording


def start_rows(record: Record, since_s: FloatArray, steps: int, stride_s: float) -> IntArray:
    """Return the start rows (n,), every `stride_s` after 2 s, with known state and commands."""
    start_s = np.arange(FIRST_START_S, since_s[-1] + 1e-9, stride_s)
    rows = np.searchsorted(since_s, start_s - 1e-6)
    # A start in a gap is dropped, not moved to the end of the gap.
    rows = np.unique(rows[since_s[rows] - start_s < _TICK_S])
    rows = rows[rows + steps < len(record)]
    known = np.asarray(np.isfinite(record.x).all(axis=1))
    commanded = np.concatenate([[0], np.cumsum(~np.isfinite(record.u).all(axis=1))])
    usable = known[rows] & (commanded[rows + steps] == commanded[rows])
    usable &= record.episode[rows] == record.episode[rows + steps]
    return np.asarray(rows[usable], dtype=np.int64)


def mean_commands(record: Record, commands: list[Reading]) -> FloatArray:
    """
    Return the mean command (n, 2) during the 25 ms that begin with each row.

    `Record.u` is the command in force at the beginning of the step. With it, a command that is
    stamped a microsecond later would reach a physics model one whole step late. After a clock
    jump the stamps do not give the order, and `Record.u` is returned.
    """
    if np.any(np.diff(record.stamp_ns) <= 0):
        return record.u
    stamps, first = np.unique([item.stamp_ns for item in commands], return_index=True)
    values = np.array([item.values for item in commands])[first]
    impulses = np.diff(stamps)[:, None] * 1e-9 * values[:-1]
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(impulses, axis=0)])

    def integral(at_ns: IntArray) -> FloatArray:
        last = np.maximum(np.searchsorted(stamps, at_ns, side="right") - 1, 0)
        return np.asarray(total[last] + values[last] * ((at_ns - stamps[last]) * 1e-9)[:, None])

    mean = (integral(record.stamp_ns + TICK_NS) - integral(record.stamp_ns)) / _TICK_S
    return np.where((record.stamp_ns < stamps[0])[:, None], record.u, mean)


def _by_trained_model(
    model: KoopmanModel, record: Record, rows: IntArray, steps: int, progress: Progress | None
) -> tuple[IntArray, FloatArray]:
    predictor = Predictor(model, horizon_steps=0)
    starts = set(rows.tolist())
    used, predicted = [], []
    last = int(rows[-1])
    for row in range(last + 1):
        prediction = predictor.step(sample_at(record, row))
        if progress is not None and row % 500 == 0:
            progress(row, last + 1)
        if row in starts and prediction is not None:
            used.append(row)
            predicted.append(predictor.rollout(record.u[row : row + steps]))
    return np.array(used, dtype=np.int64), np.array(predicted).reshape(-1, steps, 3)


def write_csv(out: Path, starts_s: FloatArray, predicted: FloatArray) -> None:
    """
    Write `start_s,t_s,v_x,v_y,yaw_rate` rows; on failure no file is written.

    Both times are in s from the bag's first message.

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
