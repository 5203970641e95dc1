# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk fleet train: a model from the recordings of many cars."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.fleet_options import (
    ClusterOption,
    DryRunOption,
    MemoryOption,
    OutOption,
    RecordingsArgument,
    RetryOption,
    TagsOption,
    TimeoutOption,
    WorkersOption,
    fleet_options,
)
from adk_ros.cli.fleet_run import continued_later, print_estimate
from adk_ros.cli.options import JsonOption, NoImuOption, ParamsOption, read_options
from adk_ros.cli.train import noted_checkpoint, print_result

_SHOWN = 5
"""Recordings that are listed with the reason why they are not used."""


def train(
    recordings: RecordingsArgument,
    model: Annotated[Path, typer.Option(help="model folder to write")],
    out: OutOption,
    params: ParamsOption = None,
    no_imu: NoImuOption = False,
    steps: Annotated[
        int, typer.Option(help="training steps, each an update from one batch of sequences")
    ] = 4000,
    seed: Annotated[int, typer.Option(help="the same seed and data give the same model")] = 0,
    device: Annotated[str, typer.Option(help="auto, cpu or cuda")] = "auto",
    hours: Annotated[float, typer.Option(help="hours of driving in memory at a time")] = 1.0,
    balance: Annotated[
        bool,
        typer.Option(
            help="draw equally from all driving conditions and tags with at most four values"
        ),
    ] = True,
    validation: Annotated[
        list[str] | None,
        typer.Option(help="vehicle that validates", show_default="a tenth of them"),
    ] = None,
    test: Annotated[
        list[str] | None,
        typer.Option(help="vehicle that the model is scored on", show_default="a fifth of them"),
    ] = None,
    tags: TagsOption = None,
    workers: WorkersOption = None,
    cluster: ClusterOption = None,
    timeout: TimeoutOption = 1800.0,
    memory: MemoryOption = 4096.0,
    retry_failed: RetryOption = False,
    dry_run: DryRunOption = False,
    force: Annotated[
        bool, typer.Option("--force", help="replace an earlier model at --model")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """
    Train a model on all recordings and score it on vehicles that it has not seen.

    Recordings are written as shards once, of which a window is in memory at a time. Continues an
    interrupted run. fleet.csv names the vehicles; a recording without one counts as another.

    Example: adk fleet train drives --model fleet_model --out fleet
    """
    started = time.monotonic()
    from adk_ros.api.fleet.default_rates import DEFAULT_STEP_S
    from adk_ros.api.fleet.fleet_run import estimate_fleet
    from adk_ros.api.fleet.fleet_training import train_fleet
    from adk_ros.api.fleet.training_data import FleetTrainingOptions, shard_stage
    from adk_ros.api.training import check_training, validation_interval
    from adk_ros.fleet.run import duration_text
    from adk_ros.train.train_settings import TrainSettings

    settings = TrainSettings(
        steps=steps, validate_every=validation_interval(steps), seed=seed, device=device
    )
    options = fleet_options(tags, workers, cluster, timeout, memory, None, retry_failed)
    training = FleetTrainingOptions(
        3600.0 * hours,
        balance,
        tuple(validation or ()),
        tuple(test or ()),
        read_options(None, None, None, no_imu, params),
    )
    if dry_run:
        stage = shard_stage(out, training)
        estimate = estimate_fleet(stage, recordings, out, options).as_dict()
        estimate["training_seconds"] = DEFAULT_STEP_S * steps
        further = (
            f"; then {steps} training steps on this machine, about "
            f"{duration_text(DEFAULT_STEP_S * steps)} by a default of {DEFAULT_STEP_S:g} s each"
        )
        print_estimate(estimate, as_json, further)
        return
    check_training(model, "blocks", 1, force)
    with (
        continued_later(),
        noted_checkpoint(model),
        console.progress("fleet") as report,
        console.stages() as progress,
    ):
        trained = train_fleet(
            recordings,
            out,
            model,
            settings=settings,
            training=training,
            options=options,
            force=force,
            fleet_progress=report,
            progress=progress,
        )
    seconds = time.monotonic() - started
    if as_json:
        console.print_json({"model": str(model), "seconds": round(seconds, 1)} | trained.facts)
        return
    print_result(trained)
    fleet = trained.facts["fleet"]
    vehicles = fleet["vehicles"]
    console.note(
        f"trained on {fleet['training_hours']:.2g} h of {len(vehicles['train'])} vehicles, in "
        f"{fleet['windows']} windows; validated on {', '.join(vehicles['validation'])}, scored on "
        f"{', '.join(vehicles['test'])}"
    )
    console.note_all(fleet["notes"])
    unused = list(fleet["recordings_not_used"].items())
    for name, reason in unused[:_SHOWN]:
        console.note(f"not used: {name}: {reason}")
    if len(unused) > _SHOWN:
        console.note(f"{len(unused) - _SHOWN} more are not used: see {model / 'manifest.json'}")
    console.note(f"trained in {seconds:.0f} s: model in {model}")
    console.note(f"report: {model / 'report.html'}")
