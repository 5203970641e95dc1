# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.rollout`: open-loop predictions along a recording, and their errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from adk_ros.api.model import TrainedModel, load_model
from adk_ros.api.output import check_output
from adk_ros.api.progress import Progress, in_stage
from adk_ros.api.recording import (
    BagRecording,
    as_recording,
    read_recording,
    recording_options,
    velocity_source,
)
from adk_ros.api.replay import missing_imu_warning
from adk_ros.api.tables import as_html, suffixed, with_units
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES, TICK_NS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TICK_S = TICK_NS * 1e-9


@dataclass(frozen=True)
class RolloutResult:
    """
    Open-loop predictions from many starts along a recording.

    `starts_s` (n,): start times, s from the bag's first message. `predicted` (n, steps, 3): states
    in SI units; entry j is (j + 1) * 25 ms after its start. `name`: name of the recording.
    `warnings`: what looks wrong in the recording. `extrinsics`: the pose of the IMU, in a line, if
    the recording gave it in `/tf_static`.
    """

    name: str
    starts_s: FloatArray
    predicted: FloatArray
    warnings: list[str]
    extrinsics: str
    _read: Callable[[], BagRecording]

    @property
    def steps(self) -> int:
        """Steps of 25 ms in a prediction."""
        return int(self.predicted.shape[1])

    @property
    def horizon_s(self) -> float:
        """Length of a prediction in s."""
        return self.steps * _TICK_S

    @property
    def times_s(self) -> FloatArray:
        """Time of each predicted state (n, steps), s from the bag's first message."""
        return np.asarray(self.starts_s[:, None] + _TICK_S * np.arange(1, self.steps + 1))

    @cached_property
    def measured(self) -> FloatArray:
        """Measured state at each predicted time (n, steps, 3), SI units; NaN in gaps."""
        return self._read().measured_at(self.times_s)

    @cached_property
    def frame(self) -> pd.DataFrame:
        """
        One row per predicted state, SI units.

        Index (`start_s`, `t_s`): start and time of the state, s from the bag's first message.
        Columns `v_x`, `v_y`, `yaw_rate`: predicted; `*_measured`: measured, NaN in gaps.
        """
        starts_s = np.repeat(self.starts_s, self.steps)
        index = pd.MultiIndex.from_arrays(
            [starts_s, self.times_s.ravel()], names=["start_s", "t_s"]
        )
        columns = dict(zip(STATE_NAMES, self.predicted.reshape(-1, 3).T, strict=True))
        columns |= dict(zip(suffixed("measured"), self.measured.reshape(-1, 3).T, strict=True))
        return with_units(pd.DataFrame(columns, index=index), self.name)

    @cached_property
    def errors(self) -> pd.DataFrame:
        """
        RMSE of the predictions by horizon.

        Index `horizon_s`; columns `v_x`, `v_y` in m/s, `yaw_rate` in rad/s, and `starts`, the
        number of starts with a measurement at that horizon.
        """
        error = self.predicted - self.measured
        known = np.asarray(np.isfinite(error).all(axis=2))
        count = known.sum(axis=0)
        total = np.where(known[..., None], error**2, 0.0).sum(axis=0)
        rmse = np.sqrt(total / np.where(count > 0, count, np.nan)[:, None])
        index = pd.Index(np.round(_TICK_S * np.arange(1, self.steps + 1), 3), name="horizon_s")
        columns = dict(zip(STATE_NAMES, rmse.T, strict=True))
        return with_units(pd.DataFrame(columns | {"starts": count}, index=index), self.name)

    def figure(self) -> Figure:
        """Draw the measured states and the predictions, one curve per start."""
        from adk_ros.api.figures import state_figure

        gap = np.full((len(self.starts_s), 1, 3), np.nan)
        times_s = np.concatenate([self.times_s, self.times_s[:, -1:]], axis=1).ravel()
        measured = np.concatenate([self.measured, gap], axis=1).reshape(-1, 3)
        predicted = np.concatenate([self.predicted, gap], axis=1).reshape(-1, 3)
        return state_figure(
            times_s,
            {"measured": measured, "predicted": predicted},
            f"{self.name}: open-loop predictions of {self.horizon_s:g} s",
        )

    def write_csv(self, out: Path | str, force: bool = False) -> None:
        """
        Write `start_s,t_s,v_x,v_y,yaw_rate` rows in SI units.

        :raises UsageError: `out` exists and `force` is not set, or cannot be written.
        """
        from adk_ros.offline.rollout import write_csv

        check_output(Path(out), force, None)
        write_csv(Path(out), self.starts_s, self.predicted)

    def _repr_html_(self) -> str:
        title = f"{len(self.starts_s)} rollouts of {self.horizon_s:g} s on {self.name}"
        return as_html(title, self.errors.iloc[[0, len(self.errors) // 2, -1]])


def rollout(
    recording: BagRecording | Path | str,
    model: TrainedModel | Path | str,
    *,
    horizon_s: float = 1.0,
    stride_s: float = 0.5,
    options: RecordingOptions | None = None,
    progress: Progress | None = None,
) -> RolloutResult:
    """
    Predict open loop from many starts along a recording, with its own commands.

    Measurements up to each start may be used, none after it.

    :param recording: a recording or a bag.
    :param model: a trained model or its folder; a vehicle's YAML file or name; or a YAML file
        written by `adk mismatch` (simulation.yaml, corrected.yaml).
    :param horizon_s: length of each prediction, 0.025 to 10 s.
    :param stride_s: time between starts, 0.025 to 3600 s.
    :param options: how to read a bag; default: with the sensor configuration of the model.
    :raises UsageError: an argument is invalid, or the model cannot be read.
    :raises DataError: the recording is unusable, or has no start with future commands known.

    Example::

        rollouts = adk_ros.rollout("bags/town", "models/handling", horizon_s=2.0)
        rollouts.errors.plot()
    """
    from adk_ros.mismatch.deployment.surrogate_file import is_surrogate_file
    from adk_ros.offline import rollout as offline

    steps = offline.horizon_steps(horizon_s, stride_s)
    if not isinstance(model, TrainedModel) and is_surrogate_file(Path(model)):
        return _surrogate_rollout(recording, Path(model), steps, stride_s, options, progress)
    if not isinstance(model, TrainedModel) and Path(model).is_dir():
        model = load_model(model)
    predicting = (
        model.artefact.model
        if isinstance(model, TrainedModel)
        else offline.find_vehicle(Path(model))
    )
    if options is None and not isinstance(recording, BagRecording):
        stored = model.sensors if isinstance(model, TrainedModel) else None
        options = recording_options(stored_sensors=stored)
    read = as_recording(recording, options, progress)
    uses_commands = not isinstance(model, TrainedModel) or model.uses_commands
    if read.topics.command is None and uses_commands:
        raise DataError(
            f"bag {read.path}: no command: a rollout predicts with the recorded commands; record "
            "them, or predict with adk replay"
        )
    starts_s, predicted = offline.rollout(
        predicting, read.content, steps, stride_s, in_stage(progress, "rolling out")
    )
    warnings = read.warnings
    if isinstance(model, TrainedModel):
        warnings += missing_imu_warning(read, model)
    extrinsics = read.content.extrinsics
    return RolloutResult(read.name, starts_s, predicted, warnings, extrinsics, lambda: read)


def _surrogate_rollout(
    recording: BagRecording | Path | str,
    model: Path,
    steps: int,
    stride_s: float,
    options: RecordingOptions | None,
    progress: Progress | None,
) -> RolloutResult:
    """Predict with a surrogate model, which reads the bag at the sensors' native rates."""
    from adk_ros.offline.rollout import rollout_surrogate

    if isinstance(recording, BagRecording):
        read = as_recording(recording, options, progress)
        path, options = read.path, read.options
    else:
        path = Path(recording)
        options, _ = velocity_source(path, options)
    report = in_stage(progress, f"reading {path.name}")
    starts_s, predicted, log = rollout_surrogate(model, path, options, steps, stride_s, report)

    def measured() -> BagRecording:
        if isinstance(recording, BagRecording):
            return recording
        return read_recording(path, options)

    warnings = list(log.warnings)
    return RolloutResult(path.name, starts_s, predicted, warnings, log.extrinsics, measured)
