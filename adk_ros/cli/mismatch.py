# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk mismatch: the physics that a simulation lacks compared with a recording."""

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
    OdometryOption,
    ParamsOption,
    RecordingParamsOption,
    options_of_recordings,
    read_options,
)


def mismatch(
    simulation: Annotated[
        Path,
        typer.Option(
            help="bag of the simulator, or the vehicle file of the simulated car (YAML, at least "
            "mass and wheelbase; the rest is assumed as of a car of that size), or the "
            "simulation.yaml of an earlier report"
        ),
    ],
    recording: Annotated[
        list[Path],
        typer.Option(
            help="bag of the real car (repeatable: several recordings of one car, in their order "
            "in time, are analysed jointly and compared)"
        ),
    ],
    out: Annotated[Path, typer.Option(help="folder for the report")],
    vehicle: Annotated[
        Path | None,
        typer.Option(
            help="vehicle file of the simulated car: YAML or packaged name. Its mass must be that "
            "of the simulation: one that differs by more than 8 % from what the bag implies is "
            "refused. Default: mass estimated from the bag, wheel radius 0.325 m"
        ),
    ] = None,
    held_out: Annotated[
        list[Path] | None,
        typer.Option(
            help="another bag of the same car (repeatable), which measures the improvement, can "
            "withdraw claims and decides what is exported. Effects are then chosen on all of the "
            "recordings, a weak formula is not claimed, and several effects are not confirmed one "
            "by one. Default: the last quarter of each recording, which the measured fit excludes"
        ),
    ] = None,
    ask: Annotated[
        list[str] | None,
        typer.Option(
            help="effect of the catalogue, such as steering_lag: why is it claimed, or not, and "
            "what would decide (repeatable, or several separated by commas)"
        ),
    ] = None,
    without_imu: Annotated[
        bool,
        typer.Option(
            "--without-imu",
            help="accept a recording without an IMU and use odometry only; an IMU that is there "
            "is used, unlike with --no-imu of 'adk train'",
        ),
    ] = False,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    params: ParamsOption = None,
    recording_params: RecordingParamsOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Find what a simulation lacks and write a corrected model.

    Compares a simulation with a recording of the real car, names the missing effects with
    size, interval and confidence, then wrong calibrations with the parameters to set, and writes
    report.html, mismatch.json, simulation.yaml, corrected.yaml and held_out.yaml (fitted without
    the held-out data). Takes 0.5 to 3 min on one
    AMD EPYC core.

    Example: adk mismatch --simulation sim --recording real --vehicle vehicle.yaml --out report
    """
    from adk_ros.api.explain import explain
    from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown

    simulated_with = read_options(imu, odometry, command, False, params)
    options = options_of_recordings(simulated_with, recording_params)
    asked = [name.strip() for given in ask or () for name in given.split(",")]
    try:
        # A terminated run leaves no half-written report.
        with graceful_shutdown(), console.stages() as progress:
            result = explain(
                simulation,
                recording,
                vehicle,
                out,
                held_out=held_out or (),
                ask=asked,
                without_imu=without_imu,
                options=options,
                simulation_options=simulated_with,
                force=force,
                progress=progress,
            )
    except Terminated:
        console.note("adk: terminated")
        raise typer.Exit(TERMINATED) from None
    console.note_all(result.extrinsics)
    console.warn_all(result.warnings)
    if as_json:
        console.print_json(result.as_dict())
        return
    # Both are bags: given in the wrong order, all sizes would have the wrong sign.
    console.note(f"recording {', '.join(map(str, recording))} against simulation {simulation}")
    for text in result.notes:
        console.note(text)
    rows = result.as_dict()["scope"]["rows"]
    if any(row["possible"] != "yes" for row in rows):
        console.print_scope(rows)
    console.output.print(result.summary, markup=False)
    for text in result.answers:
        console.output.print(f"\n{text}", markup=False)
    console.note(
        f"report.html, mismatch.json and the models (simulation, corrected, held_out) in {out}"
    )
