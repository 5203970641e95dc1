# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk detectable: the smallest effects that `adk mismatch` would name, before recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import (
    CommandOption,
    ForceOption,
    ImuOption,
    JsonOption,
    OdometryOption,
    ParamsOption,
    read_options,
)

if TYPE_CHECKING:
    import pandas as pd


def detectable(
    simulation: Annotated[Path, typer.Option(help="bag of the simulator")],
    vehicle: Annotated[
        Path | None, typer.Option(help="vehicle file of the simulated car: YAML or packaged name")
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option(
            help="bag of the real car, for the noise of its sensors. Default: the sensors that "
            "'adk simulate' assumes"
        ),
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(
            help="standard deviations of a sample of a_x, a_y, gyro, v_x, v_y and yaw rate, SI "
            "units, separated by commas"
        ),
    ] = None,
    minutes: Annotated[
        str, typer.Option(help="durations of the recording, separated by commas")
    ] = "2,5,10,30",
    out: Annotated[Path | None, typer.Option(help="CSV file to write")] = None,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    params: ParamsOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Show the smallest effects that a recording would reveal.

    For each effect of the catalogue: the size that 'adk mismatch' would name with a probability of
    80 % after so many minutes of driving like that of the simulation, and what limits it. Sizes
    are differences from the simulation. Takes about 1 min on one AMD EPYC core.

    Example: adk detectable --simulation sim --vehicle vehicle.yaml --minutes 5,20
    """
    from adk_ros.api.detectable import detectable as run
    from adk_ros.api.output import check_output

    if out is not None:
        check_output(out, force, None, simulation)
    options = read_options(imu, odometry, command, False, params)
    with console.stages() as progress:
        frame = run(
            simulation,
            vehicle,
            recording,
            noise=None if noise is None else _numbers("--noise", noise),
            minutes=_numbers("--minutes", minutes),
            options=options,
            progress=progress,
        )
    console.note_all(frame.attrs["extrinsics"])
    console.warn_all(frame.attrs["warnings"])
    if out is not None:
        frame.to_csv(out)
    if as_json:
        console.print_json(frame.reset_index().to_dict(orient="records"))
        return
    _print(frame)


def _numbers(option: str, text: str) -> list[float]:
    from adk_ros.errors import UsageError

    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(f"{option} {text}: numbers separated by commas are needed") from None


def _print(frame: pd.DataFrame) -> None:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=0, pad_edge=False)
    durations = list(dict.fromkeys(frame.index.get_level_values("minutes")))
    table.add_column("effect, parameter")
    table.add_column(" unit")
    for duration in durations:
        table.add_column(f" {duration:g} min", justify="right")
    table.add_column(" limited by")
    for (effect, parameter), rows in frame.groupby(level=["effect", "parameter"], sort=False):
        sizes = [f" {x:.2g}" if math.isfinite(x) else " -" for x in rows["size"]]
        last = rows.iloc[-1]
        table.add_row(f"{effect}, {parameter}", f" {last['unit']}", *sizes, f" {last['limit']}")
    console.print_table(table)
