# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk train: bags in, model folder and report out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adk_ros.cli import console
from adk_ros.cli.options import (
    BagsArgument,
    CommandOption,
    ForceOption,
    ImuOption,
    JsonOption,
    NoImuOption,
    OdometryOption,
    ParamsOption,
    read_options,
)
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.api.model import TrainedModel
    from adk_ros.api.recording import BagRecording
    from adk_ros.bags.recording import RecordingOptions
    from adk_ros.train.network_fit import Step

_DEFAULT_TRAINING = (
    "steps", "history", "hidden", "learning_rate", "quadratic", "speed_augmentation",
    "single_track",
)  # fmt: skip
"""Options that the paper's training does not have."""
_SCALARS_INTERVAL = 20
"""Steps between two rows of TensorBoard scalars."""


def train(
    context: typer.Context,
    bags: BagsArgument,
    out: Annotated[Path, typer.Option(help="model folder to write")],
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    no_imu: NoImuOption = False,
    params: ParamsOption = None,
    split: Annotated[
        str,
        typer.Option(
            help="test data: blocks (spread over time), tail (end of each bag) or bags (the "
            "last bag)"
        ),
    ] = "blocks",
    steps: Annotated[
        int, typer.Option(help="training steps, each an update from one batch of sequences")
    ] = 4000,
    history: Annotated[int, typer.Option(help="past samples used in addition to the state")] = 5,
    hidden: Annotated[
        int,
        typer.Option(
            help="width of the encoder's hidden layers; three quarters of it (24 by default) with "
            "quadratic features"
        ),
    ] = 32,
    learning_rate: Annotated[
        float, typer.Option(help="peak learning rate of the optimiser")
    ] = 4e-3,
    quadratic: Annotated[
        bool, typer.Option(help="add quadratic features, fitted by least squares")
    ] = True,
    speed_augmentation: Annotated[
        bool,
        typer.Option(
            help="fit the quadratic features to data scaled to higher speeds as well, in the "
            "equations that the data do not contradict"
        ),
    ] = True,
    single_track: Annotated[
        bool,
        typer.Option(
            help="outside the range of the training data, blend into a single-track model with "
            "tyre forces, identified from the same data"
        ),
    ] = False,
    seed: Annotated[int, typer.Option(help="the same seed and data give the same model")] = 0,
    device: Annotated[str, typer.Option(help="auto, cpu or cuda")] = "auto",
    paper: Annotated[
        str | None,
        typer.Option(
            help="train as in the paper: dk (deep Koopman model) or aldk (deep Koopman model with "
            "acceleration loss)"
        ),
    ] = None,
    epochs: Annotated[
        int | None,
        typer.Option(help="epochs, only with --paper", show_default="2000, as in the paper"),
    ] = None,
    force: ForceOption = False,
    tensorboard: Annotated[
        Path | None, typer.Option(help="folder to write TensorBoard scalars to")
    ] = None,
    report: Annotated[bool, typer.Option(help="write report.html and figures")] = True,
    as_json: JsonOption = False,
) -> None:
    """
    Train a model from recordings and score it on held-out data.

    Takes 152 s of processor time for 4000 steps on 403 s of recordings, measured by 'adk bench
    learned', and prints its duration. Resumes if it was interrupted and is started again with the
    same options.

    Example: adk train bags/handling --out models/handling
    """
    started = time.monotonic()
    from adk_ros.api.training import check_training, train_model, validation_interval
    from adk_ros.train.paper_training import STEPS_PER_REPORT as PAPER_STEPS_PER_REPORT
    from adk_ros.train.train_settings import PaperSettings, TrainSettings

    settings: TrainSettings | PaperSettings
    if paper is None:
        if epochs is not None:
            raise UsageError("--epochs needs --paper; the default training takes --steps")
        settings = TrainSettings(
            steps=steps,
            history=history,
            hidden=hidden,
            learning_rate=learning_rate,
            quadratic=quadratic,
            speed_augmentation=speed_augmentation,
            single_track=single_track,
            seed=seed,
            device=device,
            validate_every=validation_interval(steps),
        )
    elif paper in ("dk", "aldk"):
        _refuse_options_without_effect(context)
        settings = PaperSettings(
            acceleration=paper == "aldk",
            epochs=PaperSettings.epochs if epochs is None else epochs,
            seed=seed,
            device=device,
        )
    else:
        raise UsageError(f"--paper {paper} is unknown: choose dk or aldk")
    check_training(out, split, len(bags), force)
    recordings = read_recordings(bags, read_options(imu, odometry, command, no_imu, params))
    note_resumed = _resumption_note(1 if paper is None else PAPER_STEPS_PER_REPORT)
    with _scalars(tensorboard) as write_scalars, console.stages() as progress:

        def on_step(step: Step) -> None:
            note_resumed(step)
            write_scalars(step)

        with noted_checkpoint(out):
            model = train_model(
                recordings,
                out,
                settings=settings,
                split=split,
                report=report,
                force=force,
                progress=progress,
                on_step=on_step,
            )
    seconds = time.monotonic() - started
    if as_json:
        console.print_json({"model": str(out), "seconds": round(seconds, 1)} | model.facts)
        return
    print_result(model)
    data_s = sum(recording.duration_s for recording in recordings)
    console.note(f"trained on {data_s:.0f} s of recordings in {seconds:.0f} s: model in {out}")
    if report:
        console.note(f"report: {out / 'report.html'}")


def _refuse_options_without_effect(context: typer.Context) -> None:
    """Refuse what is given for the default training with `--paper`."""
    given = [
        f"--{name.replace('_', '-')}"
        for name in _DEFAULT_TRAINING
        if getattr(context.get_parameter_source(name), "name", "") == "COMMANDLINE"
    ]
    if given:
        raise UsageError(f"{', '.join(given)}: no effect with --paper: leave it out")


@contextmanager
def noted_checkpoint(model: Path) -> Iterator[None]:
    """Say after an interruption of a training that writes `model` whether it resumes."""
    from adk_ros.train.training_run import checkpoints_of

    try:
        yield
    except KeyboardInterrupt:
        if any(path.is_file() for path in checkpoints_of(model)):
            console.note("the same command resumes from the last checkpoint")
        raise


def read_recordings(bags: list[Path], options: RecordingOptions) -> list[BagRecording]:
    """Read the bags; print the topics that were chosen and the warnings of each."""
    from adk_ros.api.recording import read_recording

    recordings = []
    for path in bags:
        with console.stages() as progress:
            recording = read_recording(path, options, progress)
        topics = recording.topics
        console.note(
            f"{path}: imu {topics.imu or 'none (yaw rate from odometry)'}, odometry "
            f"{topics.odometry}, command {topics.command or 'none (zeros)'}; "
            f"{recording.duration_s:.1f} s"
        )
        console.note_all([recording.content.extrinsics])
        console.warn_all(recording.warnings)
        recordings.append(recording)
    if any(x.options.sensors != recordings[0].options.sensors for x in recordings):
        console.warn(
            "the bags differ in the pose of the IMU (/tf_static): the model stores that of the "
            "first"
        )
    return recordings


def print_result(model: TrainedModel) -> None:
    """Print the scores on held-out data, and which step was kept."""
    from adk_ros.model.uncertainty.fallback import summary
    from adk_ros.train.dataset import TEST

    run = model.training
    if run is None:
        return
    if run.test is None:
        console.warn("the held-out data are too short to score")
    else:
        test_s = run.split.seconds(TEST)
        console.print_scores(run.test, f"RMSE on {test_s:.0f} s of held-out data")
    takeovers = summary(run.model.fallback.takeovers())
    if takeovers:
        console.note(
            f"naive predictors take over where the model is not shown to be better: {takeovers}"
        )
    if run.trained is not None and run.trained.unaugmented:
        console.note(
            "the fastest data contradict the augmentation to higher speeds, left out of "
            f"{run.trained.unaugmented_text}"
        )
    wants_single_track = run.facts["settings"].get("single_track", False)
    if wants_single_track and run.trained is not None and run.trained.single_track is None:
        console.note("the single-track model does not predict the validation data: it is left out")
    if run.trained is not None and run.trained.stopped_early:
        console.note(
            "stopped early because the validation loss no longer improved: the model is that of "
            f"training step {run.trained.best_step}"
        )


def _ignore(_: Step) -> None:
    """Do nothing with a step."""


def _resumption_note(reported_every: int) -> Callable[[Step], None]:
    """Return a callback for reported steps that prints a note if steps before the first exist."""
    first = True

    def on_step(step: Step) -> None:
        nonlocal first
        before = step.step - reported_every
        if first and before > 0:
            console.note(f"resuming from training step {before}, where training was interrupted")
        first = False

    return on_step


@contextmanager
def _scalars(folder: Path | None) -> Iterator[Callable[[Step], None]]:
    """
    Yield a callback that writes every 20th step to TensorBoard; without a folder it does nothing.

    :raises UsageError: TensorBoard is not installed.
    """
    if folder is None:
        yield _ignore
        return
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise UsageError(
            "--tensorboard needs the tensorboard package: pip install tensorboard"
        ) from None
    writer: Any = SummaryWriter(str(folder))

    def on_step(step: Step) -> None:
        if step.step % _SCALARS_INTERVAL:
            return
        writer.add_scalar("loss/train", step.loss, step.step)
        writer.add_scalar("learning_rate", step.learning_rate, step.step)
        if not math.isnan(step.validation):
            writer.add_scalar("loss/validation", step.validation, step.step)

    try:
        yield on_step
    finally:
        writer.close()
