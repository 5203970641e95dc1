# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Open-loop predictions along a bag, by a trained model or by a physics model: `rollouts.csv`.

From every start, the prediction under the bag's own commands. Measurements up to the start may be
used, none after it: a trained model adapts up to each start, the 7-DoF model starts from the
sample alone. Of the commands before, it also knows what the actuators have reached.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from adk_ros.bags.recording import Recording, RecordingOptions
from adk_ros.errors import DataError, UsageError
from adk_ros.mismatch.deployment.open_loop import OpenLoopPredictor, start_times_of
from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.model.evaluation import sample_at
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.identification.vehicle_rollout import actuator_states
from adk_ros.plant.identification.vehicle_rollout import rollout as seven_dof_rollout
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle, vehicles
from adk_ros.signals.channels import TICK_NS, Reading, Record

FIRST_START_S = 2.0
_TICK_S = TICK_NS * 1e-9

Progress = Callable[[int, int], None]


def horizon_steps(horizon_s: float, stride_s: float) -> int:
    """
    Return the ticks in a horizon.

    :raises UsageError: horizon or stride out of range.
    """
    if not _TICK_S <= horizon_s <= 10.0:
        raise UsageError(f"--horizon {horizon_s:g} is out of range: choose 0.025 to 10 s")
    if not _TICK_S <= stride_s <= 3600.0:
        raise UsageError(f"--stride {stride_s:g} is out of range: choose 0.025 to 3600 s")
    return round(horizon_s / _TICK_S)


def find_vehicle(source: Path) -> Vehicle:
    """
    Load a vehicle's YAML, or one that comes with the package, by its name.

    :raises UsageError: it is neither, or no vehicle.
    """
    if source.is_file() or str(source) in vehicles():
        return load_vehicle(source)
    raise UsageError(
        f"model {source} does not exist: give the folder that 'adk train' wrote, a vehicle's YAML "
        f"or one of: {', '.join(vehicles())}"
    )


def rollout(
    model: KoopmanModel | Vehicle,
    drive: Recording,
    steps: int,
    stride_s: float,
    progress: Progress | None = None,
) -> tuple[FloatArray, FloatArray]:
    """
    Return starts (n,), seconds from the bag's first message, and predictions (n, steps, 3) in SI.

    Entry j of a prediction is j + 1 ticks after its start.
    :raises DataError: no start has a state and known commands over the horizon.
    """
    record = drive.record
    since_s = np.asarray((record.stamp_ns - drive.start_ns) * 1e-9, dtype=np.float64)
    rows = start_rows(record, since_s, steps, stride_s)
    if rows.size == 0:
        raise DataError(
            f"{record.name}: from no start after {FIRST_START_S:g} s are commands known for "
            f"{steps * _TICK_S:g} s: give a longer bag, or a shorter --horizon"
        )
    if isinstance(model, KoopmanModel):
        rows, predicted = _by_model(model, record, rows, steps, progress)
    else:
        u = mean_commands(record, drive.commands)
        predicted = seven_dof_rollout(
            model,
            record.x[rows],
            u[rows[:, None] + np.arange(steps)],
            actuators=_actuator_states(model, record, u)[rows],
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
) -> tuple[FloatArray, FloatArray]:
    """
    Return starts and predictions as `roll_out` does, by a model that `adk mismatch` wrote.

    :raises UsageError: the file or the bag cannot be read.
    :raises DataError: the bag lacks a stream, or there is no start.
    """
    surrogate = load_surrogate(model)
    recording = read_sensor_log(bag, options, progress, needs_imu=False)
    starts = start_times_of(recording, steps, stride_s, FIRST_START_S)
    return starts, OpenLoopPredictor(surrogate.content, recording).predict(starts, steps)


def start_rows(record: Record, since_s: FloatArray, steps: int, stride_s: float) -> IntArray:
    """Rows (n,) to start from: every `stride_s` after the first 2 s, state and commands known."""
    wanted = np.arange(FIRST_START_S, since_s[-1] + 1e-9, stride_s)
    rows = np.searchsorted(since_s, wanted - 1e-6)
    # In a gap of the grid there is nothing to start from, and what comes after it is no start.
    rows = np.unique(rows[since_s[rows] - wanted < _TICK_S])
    rows = rows[rows + steps < len(record)]
    known = np.asarray(np.isfinite(record.x).all(axis=1))
    commanded = np.concatenate([[0], np.cumsum(~np.isfinite(record.u).all(axis=1))])
    usable = known[rows] & (commanded[rows + steps] == commanded[rows])
    usable &= record.episode[rows] == record.episode[rows + steps]
    return np.asarray(rows[usable], dtype=np.int64)


def mean_commands(record: Record, commands: list[Reading]) -> FloatArray:
    """
    Mean (n, 2) of what was commanded during the tick that begins with each row.

    `Record.u` is what is in force as the tick begins; a command given within the tick, be it a
    microsecond late, would reach a physical model a whole tick late. After a jump of the clock
    stamps do not tell the order, and `Record.u` has to do.
    """
    if np.any(np.diff(record.stamp_ns) <= 0):
        return record.u
    stamps, first = np.unique([item.stamp_ns for item in commands], return_index=True)
    values = np.array([item.values for item in commands])[first]
    given = np.diff(stamps)[:, None] * 1e-9 * values[:-1]
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(given, axis=0)])

    def until(at_ns: IntArray) -> FloatArray:
        last = np.maximum(np.searchsorted(stamps, at_ns, side="right") - 1, 0)
        return np.asarray(total[last] + values[last] * ((at_ns - stamps[last]) * 1e-9)[:, None])

    mean = (until(record.stamp_ns + TICK_NS) - until(record.stamp_ns)) / _TICK_S
    return np.where((record.stamp_ns < stamps[0])[:, None], record.u, mean)


def _actuator_states(vehicle: Vehicle, record: Record, u: FloatArray) -> FloatArray:
    """What torque and angle have reached at each row (n, 2), by its episode's commands so far."""
    reached = np.full_like(u, np.nan)
    for episode in np.unique(record.episode):
        rows = (record.episode == episode) & np.isfinite(u).all(axis=1)
        reached[rows] = actuator_states(vehicle, u[rows])
    return reached


def _by_model(
    model: KoopmanModel, record: Record, rows: IntArray, steps: int, progress: Progress | None
) -> tuple[IntArray, FloatArray]:
    predictor = Predictor(model, horizon_steps=0)
    wanted = set(rows.tolist())
    kept, predicted = [], []
    last = int(rows[-1])
    for row in range(last + 1):
        made = predictor.step(sample_at(record, row))
        if progress is not None and row % 500 == 0:
            progress(row, last + 1)
        if row in wanted and made is not None:
            kept.append(row)
            predicted.append(predictor.rollout(record.u[row : row + steps]))
    return np.array(kept, dtype=np.int64), np.array(predicted).reshape(-1, steps, 3)


def write_csv(out: Path, starts_s: FloatArray, predicted: FloatArray) -> None:
    """
    Write `start_s,t_s,v_x,v_y,yaw_rate` rows, as one whole file or none.

    Both times are seconds from the bag's first message.
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
