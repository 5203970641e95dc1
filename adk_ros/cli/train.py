# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk train: bags in, model folder and report out."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import (
    BagsArgument,
    CommandOption,
    ImuOption,
    JsonOption,
    NoImuOption,
    OdometryOption,
    ParamsOption,
    drive_options,
)
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.bags.recording import RecordingOptions
    from adk_ros.signals.channels import Record
    from adk_ros.train.network_fit import Step
    from adk_ros.train.train_settings import PaperSettings, TrainSettings


def train(
    bags: BagsArgument,
    out: Annotated[Path, typer.Option(help="model folder to write")],
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    no_imu: NoImuOption = False,
    params: ParamsOption = None,
    split: Annotated[
        str, typer.Option(help="hold out 'blocks' of time, the 'tail', or the last of the 'bags'")
    ] = "blocks",
    steps: Annotated[int, typer.Option(help="updates, each of one batch of sequences")] = 4000,
    history: Annotated[int, typer.Option(help="past samples beside the state")] = 5,
    hidden: Annotated[int, typer.Option(help="width of the encoder's hidden layers")] = 32,
    learning_rate: Annotated[float, typer.Option(help="largest step of the optimiser")] = 4e-3,
    quadratic: Annotated[
        bool, typer.Option(help="quadratic forms, fitted by least squares, beside what is learned")
    ] = True,
    seed: Annotated[int, typer.Option(help="same seed, same model")] = 0,
    device: Annotated[str, typer.Option(help="auto, cpu or cuda")] = "auto",
    paper: Annotated[
        str | None, typer.Option(help="train exactly as the paper does: 'dk' or 'aldk'")
    ] = None,
    epochs: Annotated[
        int | None, typer.Option(help="epochs, with --paper alone; the paper's 2000 by default")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="replace a model at --out")] = False,
    tensorboard: Annotated[Path | None, typer.Option(help="write scalars to this folder")] = None,
    report: Annotated[bool, typer.Option(help="write report.html and figures")] = True,
    as_json: JsonOption = False,
) -> None:
    """
    Train a model from recordings and score it on held-out data.

    Example: adk train bags/handling --out models/handling
    """
    started = time.monotonic()
    from adk_ros.model.artefact import MANIFEST
    from adk_ros.train.dataset import TEST
    from adk_ros.train.train_settings import PaperSettings, TrainSettings
    from adk_ros.train.training_report import remove_report, write_report
    from adk_ros.train.training_run import checkpoints_of, run_training

    settings: TrainSettings | PaperSettings
    if (out / MANIFEST).is_file() and not force:
        raise UsageError(f"{out} holds a model already: add --force to replace it")
    if paper is None:
        if epochs is not None:
            raise UsageError("--epochs is for --paper; the default training takes --steps")
        settings = TrainSettings(
            steps=steps,
            history=history,
            hidden=hidden,
            learning_rate=learning_rate,
            quadratic=quadratic,
            seed=seed,
            device=device,
            validate_every=min(200, max(1, steps // 10)),
        )
    elif paper in ("dk", "aldk"):
        settings = PaperSettings(acceleration=paper == "aldk", epochs=epochs or 2000, seed=seed)
    else:
        raise UsageError(f"--paper {paper} is unknown: choose dk or aldk")
    options = drive_options(imu, odometry, command, no_imu, params)
    records = read_records(bags, options)
    writer = _scalars(tensorboard)
    begun = paper is not None
    with console.progress("training") as bar, console.progress("tuning and scoring") as after:

        def on_step(step: Step) -> None:
            nonlocal begun
            if not begun and step.step > 1:
                console.note(f"going on from step {step.step - 1}, where it was interrupted")
            begun = True
            text = f"loss {step.loss:.4f}"
            if not math.isnan(step.validation):
                text += f", validation {step.validation:.4f}"
            bar(step.step, step.steps, text)
            if writer is not None and step.step % 20 == 0:
                writer.add_scalar("loss/train", step.loss, step.step)
                writer.add_scalar("learning_rate", step.learning_rate, step.step)
                if not math.isnan(step.validation):
                    writer.add_scalar("loss/validation", step.validation, step.step)

        def on_note(what: str, done: int, total: int) -> None:
            after(done, total, what)

        try:
            run = run_training(records, out, settings, split, options.sensors, on_step, on_note)
        except KeyboardInterrupt:
            if any(path.is_file() for path in checkpoints_of(out)):
                console.note("the same command goes on from the last checkpoint")
            raise
    if writer is not None:
        writer.close()
    if report:
        write_report(run, out)
    else:
        remove_report(out)
    seconds = time.monotonic() - started
    if as_json:
        console.print_json({"model": str(out), "seconds": round(seconds, 1)} | run.facts)
        return
    if run.test is None:
        console.warn("nothing was held out that is long enough to score")
    else:
        held_s = run.split.seconds(TEST)
        console.show_test(run.test, f"RMSE on {held_s:.0f} s not trained on, commands known")
    if run.trained is not None and run.trained.stopped_early:
        kept = run.trained.best_step
        console.note(f"stopped early, since the validation no longer gained: step {kept} is kept")
    data_s = sum(record.duration_s for record in records)
    console.note(f"trained on {data_s:.0f} s of driving in {seconds:.0f} s: model in {out}")
    if report:
        console.note(f"report: {out / 'report.html'}")


def read_records(bags: list[Path], options: RecordingOptions) -> list[Record]:
    """Read all bags, with a progress bar, telling what was odd about them."""
    from adk_ros.bags.recording import read_recording

    records = []
    for path in bags:
        with console.progress(f"reading {path.name}") as bar:
            drive = read_recording(path, options, bar)
        topics = drive.topics
        console.note(
            f"{path}: imu {topics.imu or 'none (yaw rate from odometry)'}, odometry "
            f"{topics.odometry}, command {topics.command}; {drive.record.duration_s:.1f} s"
        )
        console.print_recording_warnings(drive)
        records.append(drive.record)
    return records


def _scalars(folder: Path | None):  # type: ignore[no-untyped-def]
    if folder is None:
        return None
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise UsageError(
            "--tensorboard needs the tensorboard package: pip install tensorboard"
        ) from None
    return SummaryWriter(str(folder))
