# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk replay: a recording through the predictor, scored, its predictions written as a bag."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import (
    BagArgument,
    CommandOption,
    ForceOption,
    ImuOption,
    JsonOption,
    ModelOption,
    NoImuOption,
    OdometryOption,
    ParamsOption,
    read_options,
)


def replay(
    bag: BagArgument,
    model: ModelOption,
    out: Annotated[Path | None, typer.Option(help="bag to write the predictions to")] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="online method: constant (no adaptation), rls (recursive least squares), ffrls "
            "(the same with forgetting factor), swls (sliding-window least squares, as in the "
            "paper) or windowed (ridge regression over a window)",
            show_default="the model's",
        ),
    ] = None,
    window: Annotated[
        int | None,
        typer.Option(
            help="samples in the window of windowed and swls", show_default="the model's"
        ),
    ] = None,
    ridge: Annotated[
        float | None,
        typer.Option(
            help="ridge weight towards the offline model (windowed only), in samples",
            show_default="the model's",
        ),
    ] = None,
    horizon: Annotated[
        float, typer.Option(help="length of the predicted horizon in s; 0: none")
    ] = 2.0,
    with_horizon: Annotated[
        bool,
        typer.Option("--with-horizon", help="write the horizons as well (about 6 MB per min)"),
    ] = False,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    no_imu: NoImuOption = False,
    params: ParamsOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Replay a recording offline and score the predictions.

    The predictions are those that the live node would have published. Naive predictors are scored
    on the same data for comparison; --out writes the predictions as a bag. Takes about 15 s for
    a recording of 1 min on an AMD EPYC, 2 cores.

    Example: adk replay bags/town --model models/handling --out predicted
    """
    from adk_ros.api.model import load_model
    from adk_ros.api.replay import replay as run
    from adk_ros.ros.parameter_file import read_parameter_file

    trained = load_model(model)
    options = read_options(imu, odometry, command, no_imu, params, trained.sensors)
    # Not part of the options, which say how a recording is read.
    frame_id = "" if params is None else read_parameter_file(params)[0]["frame_id"]
    with console.stages() as progress:
        result = run(
            bag,
            trained,
            out=out,
            method=method,
            window=window,
            ridge=ridge,
            horizon_s=horizon,
            with_horizon=with_horizon,
            frame_id=frame_id,
            options=options,
            force=force,
            progress=progress,
        )
    console.note_all([result.recording.content.extrinsics])
    console.warn_all(result.warnings)
    if as_json:
        console.print_json(result.as_dict())
        return
    if result.held_out is not None:
        title = f"RMSE on {result.recording.name}, method {result.method}"
        console.print_scores(result.held_out, title)
    console.note(
        f"{len(result.predictions)} predictions 25 ms ahead on {result.ticks} samples"
        + (f", in {out}" if out else " (not written: no --out)")
    )
