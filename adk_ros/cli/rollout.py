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
    ForceOption,
    ImuOption,
    JsonOption,
    NoImuOption,
    OdometryOption,
    ParamsOption,
    read_options,
)


def rollout(
    model: Annotated[
        Path,
        typer.Option(
            help="model folder written by 'adk train', vehicle YAML or packaged vehicle name, or "
            "simulation.yaml or corrected.yaml written by 'adk mismatch'"
        ),
    ],
    bag: Annotated[Path, typer.Option(help="recording to predict along")],
    out: Annotated[Path, typer.Option(help="CSV file to write")],
    horizon: Annotated[float, typer.Option(help="length of each prediction in s")] = 1.0,
    stride: Annotated[float, typer.Option(help="time between starts in s")] = 0.5,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    no_imu: NoImuOption = False,
    params: ParamsOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Predict open loop along a recording and write a CSV file.

    From each start the recording's own commands are applied; no measurement after the start is
    used.

    Example: adk rollout --model models/handling --bag bags/town --horizon 1 --out rollouts.csv
    """
    from adk_ros.api.model import is_model_folder, load_model
    from adk_ros.api.output import check_output
    from adk_ros.api.rollout import rollout as run

    check_output(out, force, None, bag, model)
    trained = load_model(model) if is_model_folder(model) else None
    sensors = trained.sensors if trained else None
    options = read_options(imu, odometry, command, no_imu, params, sensors)
    with console.stages() as progress:
        result = run(
            bag,
            trained or model,
            horizon_s=horizon,
            stride_s=stride,
            options=options,
            progress=progress,
        )
    console.note_all([result.extrinsics])
    console.warn_all(result.warnings)
    result.write_csv(out, force)
    if as_json:
        console.print_json(
            {"out": str(out), "starts": int(result.starts_s.size), "steps": result.steps}
        )
        return
    console.note(
        f"{result.starts_s.size} rollouts of {result.horizon_s:g} s "
        f"({result.steps} ticks of 25 ms) in {out}"
    )
