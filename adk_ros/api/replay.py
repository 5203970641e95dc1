# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.replay`: what the live node would have predicted on a recording, and its scores."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from adk_ros.api.model import TrainedModel, as_model
from adk_ros.api.output import bag_files, check_output, remove_earlier_bag
from adk_ros.api.progress import Progress, in_stage
from adk_ros.api.recording import BagRecording, as_recording, recording_options
from adk_ros.api.tables import as_html, score_frame, suffixed, with_units
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import UsageError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES, TICK_NS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from adk_ros.model.adaptation.online_methods import OnlineSettings
    from adk_ros.model.pipeline import Pipeline
    from adk_ros.model.prediction import Prediction
    from adk_ros.train.held_out import HeldOutScores

_MAX_HORIZON_S = 10.0
_TICK_S = TICK_NS * 1e-9


@dataclass(frozen=True)
class ReplayResult:
    """
    Predictions of one step (25 ms) along a recording, and scores up to 2 s ahead.

    `predictions`: as the node would have published them, in order. `held_out`: the scores with
    the rollouts they come from; None if no stretch is long enough. `ticks`: samples processed.
    `restarts`: resets of the online method. `counts`: irregularities of the message streams.
    `method`: the online method. `out`: the bag written, if any.
    """

    recording: BagRecording
    model: TrainedModel
    predictions: list[Prediction]
    held_out: HeldOutScores | None
    method: str
    ticks: int
    restarts: int
    counts: Mapping[str, int]
    out: Path | None
    warnings: list[str]

    @cached_property
    def frame(self) -> pd.DataFrame:
        """
        One row per prediction, SI units.

        Index `time_s`: the time the prediction is for, s from the bag's first message. Columns:
        the predicted `v_x`, `v_y`, `yaw_rate`; `*_std`, their standard deviation; `*_measured`,
        the measurement at that time; `*_innovation`, measured minus predicted of the sample that
        the prediction starts from, NaN if there was no prediction of it.
        """
        start_ns = self.recording.content.start_ns
        stamp_ns = np.array([p.stamp_ns for p in self.predictions], dtype=np.int64)
        time_s = np.asarray((stamp_ns - start_ns) * 1e-9, dtype=np.float64)
        predicted = np.array([p.x for p in self.predictions]).reshape(-1, 3)
        covariance = np.array([p.covariance for p in self.predictions]).reshape(-1, 3, 3)
        deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        columns = dict(zip(STATE_NAMES, predicted.T, strict=True))
        columns |= dict(zip(suffixed("std"), deviation.T, strict=True))
        measured = self.recording.measured_at(time_s)
        columns |= dict(zip(suffixed("measured"), measured.T, strict=True))
        columns |= dict(zip(suffixed("innovation"), self.innovations.T, strict=True))
        index = pd.Index(time_s, name="time_s")
        return with_units(pd.DataFrame(columns, index=index), self.recording.name)

    @cached_property
    def innovations(self) -> FloatArray:
        """Measured minus predicted, one step ahead, (n, 3) in SI units; NaN where unknown."""
        return np.array([p.innovation for p in self.predictions]).reshape(-1, 3)

    @property
    def innovation_rms(self) -> FloatArray:
        """Root mean square of the innovations (3,), SI units; NaN without any."""
        known = self.innovations[np.isfinite(self.innovations).all(axis=1)]
        rms = np.sqrt(np.mean(known**2, axis=0)) if len(known) else np.full(3, math.nan)
        return np.asarray(rms)

    @cached_property
    def scores(self) -> pd.DataFrame:
        """
        Scores of the model and of the naive predictors on this recording.

        Index (channel, horizon_s); one column per predictor with its RMSE in m/s or rad/s, then
        `ratio` and `ratio_commands_held`: RMSE of the model divided by that of the best naive
        predictor, with future commands known and with commands held constant.
        """
        return score_frame(self.held_out.as_json() if self.held_out else None)

    def figure(self, horizon_s: float = 1.0) -> Figure:
        """
        Draw the measured state and the state predicted `horizon_s` before, future commands known.

        :param horizon_s: 0.025 to 2 s. Where nothing was scored, the one-step predictions are
            drawn.
        :raises UsageError: the horizon is out of range.
        """
        from adk_ros.api.figures import state_figure

        steps = round(horizon_s / _TICK_S)
        if self.held_out is None:
            frame = self.frame
            return state_figure(
                frame.index.to_numpy(),
                {
                    "measured": frame[suffixed("measured")].to_numpy(),
                    "predicted 25 ms before": frame[list(STATE_NAMES)].to_numpy(),
                },
                f"{self.recording.name}: predicted 25 ms ahead",
            )
        rollouts = self.held_out.rollouts[0]
        if not 1 <= steps <= rollouts.predicted.shape[1]:
            longest_s = rollouts.predicted.shape[1] * _TICK_S
            raise UsageError(f"horizon_s is {horizon_s:g}: choose {_TICK_S:g} to {longest_s:g} s")
        rows = rollouts.rows + steps
        return state_figure(
            self.recording.time_s[rows],
            {
                "measured": rollouts.record.x_ref[rows],
                f"predicted {horizon_s:g} s before": rollouts.predicted[:, steps - 1],
            },
            f"{self.recording.name}: predicted {horizon_s:g} s ahead, future commands known",
        )

    def as_dict(self) -> dict[str, Any]:
        """Return what `adk replay --json` prints."""
        return {
            "bag": str(self.recording.path),
            "model": str(self.model.path),
            "out": str(self.out) if self.out else None,
            "method": self.method,
            "ticks": self.ticks,
            "predictions": len(self.predictions),
            "restarts": self.restarts,
            "innovation_rms": self.innovation_rms.tolist(),
            "counts": dict(self.counts),
            "score": self.held_out.as_json() if self.held_out else None,
        }

    def _repr_html_(self) -> str:
        title = f"{len(self.predictions)} predictions on {self.recording.name}"
        return as_html(title, self.scores, self.frame)


def replay(
    recording: BagRecording | Path | str,
    model: TrainedModel | Path | str,
    *,
    out: Path | str | None = None,
    method: str | None = None,
    window: int | None = None,
    ridge: float | None = None,
    horizon_s: float = 2.0,
    with_horizon: bool = False,
    frame_id: str = "",
    options: RecordingOptions | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> ReplayResult:
    """
    Replay a recording through the predictor, as the live node receives it, and score it.

    Naive predictors take the model's place where it was trained with commands and the recording
    has none.

    :param recording: a recording or a bag.
    :param model: a trained model or its folder.
    :param out: bag to write the predictions to.
    :param method: online method: constant, rls, ffrls, swls or windowed (default: the model's).
    :param window: samples in the window of windowed and swls (default: the model's).
    :param ridge: ridge weight towards the offline model (windowed only), in samples (default:
        the model's).
    :param horizon_s: length of the predicted horizon, 0 to 10 s.
    :param with_horizon: write the horizons to `out` as well.
    :param frame_id: frame of the predictions in `out`, as the node's parameter; default:
        base_link, or centre_of_gravity if the reference point is not zero.
    :param options: how to read a bag; default: with the sensor configuration of the model.
    :param force: replace an earlier bag at `out`.
    :raises UsageError: an argument is invalid, or `out` exists.
    :raises DataError: the recording is unusable.

    Example::

        replayed = adk_ros.replay("bags/town", "models/handling")
        replayed.figure(horizon_s=1.0)
    """
    from adk_ros.model.pipeline import PipelineSettings
    from adk_ros.model.training_range import TrainingRange
    from adk_ros.model.uncertainty.fallback import Fallback
    from adk_ros.offline.replay import ReplayOutput
    from adk_ros.offline.replay import replay as run
    from adk_ros.train.held_out import score_held_out

    model = as_model(model)
    if not 0.0 <= horizon_s <= _MAX_HORIZON_S:
        raise UsageError(f"--horizon {horizon_s:g} is out of range: choose 0 to 10 s")
    online = _online_settings(model, method, window, ridge)
    target = None if out is None else Path(out)
    source = recording.path if isinstance(recording, BagRecording) else Path(recording)
    if target is not None:
        check_output(target, force, bag_files(target), source)
    if not isinstance(recording, BagRecording) and options is None:
        options = recording_options(stored_sensors=model.sensors)
    recording = as_recording(recording, options, progress)
    settings = PipelineSettings(
        sensors=recording.options.sensors,
        online=online,
        horizon_steps=round(horizon_s / _TICK_S),
        has_command=recording.topics.command is not None,
    )
    koopman = model.artefact.model
    if _lacks_commands(recording, model):
        alone = Fallback.alone(recording.topics.imu is not None and koopman.uses_imu)
        koopman = replace(koopman, fallback=alone)
    if target is not None:
        remove_earlier_bag(target)
    predictions, pipeline, _ = run(
        recording.path,
        koopman,
        settings,
        recording.options,
        None if target is None else ReplayOutput(target, with_horizon, frame_id),
        in_stage(progress, f"replaying {recording.name}"),
    )
    held_out = score_held_out(
        koopman,
        [(recording.record, None)],
        TrainingRange.from_json(model.facts.get("range")),
        online,
        progress=in_stage(progress, "scoring"),
    )
    return ReplayResult(
        recording=recording,
        model=model,
        predictions=predictions,
        held_out=held_out,
        method=online.method,
        ticks=pipeline.ticks,
        restarts=pipeline.restarts,
        counts=pipeline.aligner.counts,
        out=target,
        warnings=_warnings(recording, model, held_out) + _rejections(pipeline),
    )


def _rejections(pipeline: Pipeline) -> list[str]:
    """Return a line on each stream with rejected readings, and on withheld predictions."""
    texts = [
        f"{pipeline.gate.rejected[source]} {source.name.lower()} readings contradict the "
        f"prediction and are left out, the last one {latest}"
        for source, latest in sorted(pipeline.gate.latest.items())
    ]
    if count := pipeline.predictor.implausible:
        texts.append(f"{count} predictions are withheld: no vehicle moves as predicted")
    return texts


def _online_settings(
    model: TrainedModel, method: str | None, window: int | None, ridge: float | None
) -> OnlineSettings:
    """
    Return the model's online settings with the given ones in their place.

    :raises UsageError: a value is out of range.
    """
    online: OnlineSettings = model.artefact.model.online
    return replace(
        online,
        method=online.method if method is None else method,
        window=online.window if window is None else window,
        ridge=online.ridge if ridge is None else ridge,
    )


def _lacks_commands(recording: BagRecording, model: TrainedModel) -> bool:
    """Whether the model was trained with commands and the recording has none."""
    return recording.topics.command is None and model.uses_commands


def missing_imu_warning(recording: BagRecording, model: TrainedModel) -> list[str]:
    """Return a warning if the model was trained with an IMU and the recording has none."""
    if recording.topics.imu is not None or not model.artefact.model.uses_imu:
        return []
    return ["the model was trained with an IMU and there is none: yaw rate comes from odometry"]


def _warnings(
    recording: BagRecording, model: TrainedModel, held_out: HeldOutScores | None
) -> list[str]:
    texts = recording.warnings + missing_imu_warning(recording, model)
    if _lacks_commands(recording, model):
        texts.append(
            "the model was trained with commands and there are none: naive predictors take its "
            "place; train a model on recordings without commands, or record the commands"
        )
    if recording.name in {data["name"] for data in model.facts.get("data", [])}:
        texts.append(
            f"the model was trained on a bag named {recording.name}: these scores are not "
            "on unseen data"
        )
    if held_out is None:
        texts.append("no stretch without gaps is as long as the horizon: nothing to score")
    return texts
