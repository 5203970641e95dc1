# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk rollout: open-loop predictions along a bag, as CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import (
    CommandOption,
    ImuOption,
    JsonOption,
    NoImuOption,
    OdometryOption,
    ParamsOption,
    drive_options,
)
from adk_ros.numerics.arrays import FloatArray


def rollout(
    model: Annotated[
        Path,
        typer.Option(
            help="folder that 'adk train' wrote, a vehicle's YAML or name, or the YAML "
            "that 'adk mismatch' wrote"
        ),
    ],
    bag: Annotated[Path, typer.Option(help="the recording to start from")],
    out: Annotated[Path, typer.Option(help="CSV file to write")],
    horizon: Annotated[float, typer.Option(help="seconds to predict")] = 1.0,
    stride: Annotated[float, typer.Option(help="seconds between starts")] = 0.5,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    no_imu: NoImuOption = False,
    params: ParamsOption = None,
    as_json: JsonOption = False,
) -> None:
    """
    Predict open loop along a recording, under its own commands.

    Example: adk rollout --model models/handling --bag bags/town --horizon 1 --out rollouts.csv
    """
    from adk_ros.bags.recording import read_recording
    from adk_ros.mismatch.deployment.surrogate_file import is_surrogate_file
    from adk_ros.model import artefact
    from adk_ros.offline.rollout import find_vehicle, horizon_steps, rollout, rollout_surrogate

    steps = horizon_steps(horizon, stride)
    if is_surrogate_file(model):
        options = drive_options(imu, odometry, command, no_imu, params, None)
        with console.progress(f"reading {bag.name}") as bar:
            starts, predicted = rollout_surrogate(model, bag, options, steps, stride, bar)
        _done(out, starts, predicted, as_json)
        return
    loaded = artefact.load(model) if model.is_dir() else None
    predicting = loaded.model if loaded else find_vehicle(model)
    sensors = loaded.manifest["training"].get("sensors") if loaded else None
    options = drive_options(imu, odometry, command, no_imu, params, sensors)
    with console.progress(f"reading {bag.name}") as bar:
        drive = read_recording(bag, options, bar)
    console.print_recording_warnings(drive, loaded.model.uses_imu if loaded else False)
    with console.progress("rolling out") as bar:
        starts, predicted = rollout(predicting, drive, steps, stride, bar)
    _done(out, starts, predicted, as_json)


def _done(out: Path, starts: FloatArray, predicted: FloatArray, as_json: bool) -> None:
    from adk_ros.offline.rollout import write_csv

    write_csv(out, starts, predicted)
    steps = int(predicted.shape[1])
    if as_json:
        console.print_json(
            {
                "out": str(out),
                "starts": int(starts.size),
                "steps": steps,
            }
        )
        return
    console.note(
        f"{starts.size} predictions of {steps * 0.025:g} s ({steps} steps of 25 ms) in {out}"
    )
