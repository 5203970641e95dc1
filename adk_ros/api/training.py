# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.train_model`: recordings in, model folder and report out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from adk_ros.api.model import MANIFEST, TrainedModel, load_model
from adk_ros.api.output import check_output
from adk_ros.api.progress import Progress, in_stage
from adk_ros.api.recording import BagRecording, as_recording
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import DataError, UsageError

if TYPE_CHECKING:
    from adk_ros.train.network_fit import Step
    from adk_ros.train.train_settings import PaperSettings, TrainSettings

_VALIDATIONS = 10
"""Validations during a short training."""


def train_model(
    recordings: BagRecording | Path | str | Sequence[BagRecording | Path | str],
    out: Path | str,
    *,
    steps: int | None = None,
    seed: int | None = None,
    settings: TrainSettings | PaperSettings | None = None,
    split: str = "blocks",
    options: RecordingOptions | None = None,
    report: bool = True,
    force: bool = False,
    progress: Progress | None = None,
    on_step: Callable[[Step], None] | None = None,
) -> TrainedModel:
    """
    Train a model and score it on held-out data.

    An interrupted training resumes when it is called again with the same arguments.

    :param recordings: recordings or bags, at least one minute in all.
    :param out: model folder to write.
    :param steps: updates, each from one batch of sequences (default 4000, about two minutes).
    :param seed: the same seed and data give the same model.
    :param settings: all settings, instead of `steps` and `seed`.
    :param split: test data: "blocks" (spread over time), "tail" (end of each recording) or "bags"
        (the last recording).
    :param options: how to read bags that are given as paths, see `recording_options`.
    :param report: write report.html with figures into `out`.
    :param force: replace an earlier model in `out`.
    :param on_step: called after every update with its number, loss and learning rate.
    :return: the model with its scores; `training` holds losses, parts and rollouts.
    :raises UsageError: an argument is invalid, or `out` exists.
    :raises DataError: the recordings are unusable or too short.

    Example::

        model = adk_ros.train_model("bags/handling", out="models/handling")
        model.scores
    """
    from adk_ros.api.provenance import RunTimer
    from adk_ros.train.training_report import remove_report, write_report
    from adk_ros.train.training_run import run_training

    timer = RunTimer()
    out = Path(out)
    items = [recordings] if isinstance(recordings, (BagRecording, Path, str)) else recordings
    check_training(out, split, len(items), force)
    if settings is not None and (steps is not None or seed is not None):
        raise UsageError("give either settings, or steps and seed")
    chosen = settings or default_settings(steps, seed)
    read = [as_recording(item, options if _is_path(item) else None, progress) for item in items]
    if not read:
        raise UsageError("give at least one recording")
    _check_commands(read)
    stepped, noted = training_callbacks(progress, on_step)
    sensors = read[0].options.sensors
    run = run_training([item.record for item in read], out, chosen, split, sensors, stepped, noted)
    if report:
        sources = [("recording", item.path) for item in read]
        write_report(run, out, provenance=timer.provenance(sources))
    else:
        remove_report(out)
    return replace(load_model(out), training=run)


def _check_commands(recordings: Sequence[BagRecording]) -> None:
    """
    Check that all recordings have commands, or none.

    :raises DataError: only some have; the zeros of the others would be learned as commands.
    """
    without = [x.name for x in recordings if x.topics.command is None]
    given = [x.name for x in recordings if x.topics.command is not None]
    if without and given:
        raise DataError(
            f"{without[0]} has no command and {given[0]} has one: train a model on each kind of "
            "recording, or record the command in all of them"
        )


def training_callbacks(
    progress: Progress | None, on_step: Callable[[Step], None] | None
) -> tuple[Callable[[Step], None], Callable[[str, int, int], None]]:
    """Return what a training calls after each step and in its other stages, for `progress`."""
    report_step = in_stage(progress, "training")

    def stepped(step: Step) -> None:
        if on_step is not None:
            on_step(step)
        detail = f"loss {step.loss:.4f}"
        if not math.isnan(step.validation):
            detail += f", validation {step.validation:.4f}"
        report_step(step.step, step.steps, detail)

    def noted(stage: str, done: int, total: int) -> None:
        in_stage(progress, stage)(done, total)

    return stepped, noted


def check_training(out: Path, split: str, recordings: int, force: bool) -> None:
    """
    Check the arguments of a training before any bag is read.

    :raises UsageError: the split is unknown or needs more recordings, or `out` exists.
    """
    from adk_ros.model.artefact import check_target
    from adk_ros.train.dataset import SPLITS

    if split not in SPLITS:
        raise UsageError(f"split '{split}' is unknown: choose one of {', '.join(SPLITS)}")
    if split == "bags" and recordings < 2:
        raise UsageError("--split bags needs at least two bags: the last one is the test data")
    check_output(out, force, (MANIFEST,))
    check_target(out)


def default_settings(steps: int | None = None, seed: int | None = None) -> TrainSettings:
    """Return the default settings with another number of steps or another seed."""
    from adk_ros.train.train_settings import TrainSettings

    settings = TrainSettings()
    if seed is not None:
        settings = replace(settings, seed=seed)
    if steps is not None:
        interval = validation_interval(steps)
        settings = replace(settings, steps=steps, validate_every=interval)
    return settings


def validation_interval(steps: int) -> int:
    """Return the updates between two validations: at least ten validations in a training."""
    from adk_ros.train.train_settings import TrainSettings

    return min(TrainSettings().validate_every, max(1, steps // _VALIDATIONS))


def _is_path(item: BagRecording | Path | str) -> bool:
    return not isinstance(item, BagRecording)
