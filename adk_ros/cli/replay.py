# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk replay: a recorded drive through the predictor, scored, its predictions written as a bag."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from adk_ros.cli import console
from adk_ros.cli.options import (
    BagArgument,
    CommandOption,
    ImuOption,
    JsonOption,
    ModelOption,
    NoImuOption,
    OdometryOption,
    ParamsOption,
    drive_options,
)
from adk_ros.errors import UsageError


def replay(
    bag: BagArgument,
    model: ModelOption,
    out: Annotated[Path | None, typer.Option(help="bag to write the predictions to")] = None,
    method: Annotated[
        str | None, typer.Option(help="constant, rls, ffrls, swls or windowed [the model's own]")
    ] = None,
    window: Annotated[
        int | None, typer.Option(help="samples in the window of windowed and swls [the model's]")
    ] = None,
    ridge: Annotated[
        float | None, typer.Option(help="pull to the offline model, of windowed [the model's]")
    ] = None,
    horizon: Annotated[float, typer.Option(help="seconds of the horizon, 0 for none")] = 2.0,
    with_horizon: Annotated[
        bool, typer.Option("--with-horizon", help="write the horizons as well (large)")
    ] = False,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    no_imu: NoImuOption = False,
    params: ParamsOption = None,
    as_json: JsonOption = False,
) -> None:
    """
    Replay a recording: what the live node would have predicted.

    The predictions are scored beside naive ones; --out writes them as a bag.

    Example: adk replay bags/town --model models/handling --out predicted
    """
    from adk_ros.bags.recording import read_recording
    from adk_ros.model import artefact
    from adk_ros.model.adaptation.online_methods import OnlineSettings
    from adk_ros.model.pipeline import PipelineSettings
    from adk_ros.offline.replay import replay as run
    from adk_ros.train.held_out import TrainingDomain, score_held_out

    loaded = artefact.load(model)
    facts = loaded.manifest["training"]
    options = drive_options(imu, odometry, command, no_imu, params, facts.get("sensors"))
    online: OnlineSettings = loaded.model.online
    online = replace(
        online,
        method=online.method if method is None else method,
        window=online.window if window is None else window,
        ridge=online.ridge if ridge is None else ridge,
    )
    if not 0.0 <= horizon <= 10.0:
        raise UsageError(f"--horizon {horizon:g} is out of range: choose 0 to 10 s")
    settings = PipelineSettings(
        sensors=options.sensors, online=online, horizon_steps=round(horizon / 0.025)
    )
    with console.progress(f"replaying {bag.name}") as bar:
        predictions, pipeline, _ = run(
            bag, loaded.model, settings, options, out, with_horizon, bar
        )
    with console.progress(f"reading {bag.name}") as bar:
        drive = read_recording(bag, options, bar)
    console.print_recording_warnings(drive, loaded.model.uses_imu)
    if drive.record.name in {data["name"] for data in facts.get("data", [])}:
        console.warn(f"the model was trained on a bag named {drive.record.name}: this is no test")
    with console.progress("scoring") as bar:
        known = TrainingDomain.from_json(facts.get("range"))
        test = score_held_out(loaded.model, [(drive.record, None)], known, online, progress=bar)
    innovations = np.array([p.innovation for p in predictions]).reshape(-1, 3)
    known = innovations[np.isfinite(innovations).all(axis=1)]
    rms = np.sqrt(np.mean(known**2, axis=0)) if len(known) else np.full(3, math.nan)
    if as_json:
        console.print_json(
            {
                "bag": str(bag),
                "model": str(model),
                "out": str(out) if out else None,
                "method": online.method,
                "ticks": pipeline.ticks,
                "predictions": len(predictions),
                "restarts": pipeline.restarts,
                "innovation_rms": rms.tolist(),
                "counts": dict(pipeline.aligner.counts),
                "score": test.as_json() if test else None,
            }
        )
        return
    if test is None:
        console.warn("no stretch without a gap is as long as the horizon: nothing to score")
    else:
        console.show_test(test, f"RMSE on {drive.record.name}, method {online.method}")
    console.note(
        f"{len(predictions)} predictions on {pipeline.ticks} ticks of 25 ms"
        + (f" in {out}" if out else " (nothing written: no --out)")
    )
