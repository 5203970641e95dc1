# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk export: a bag or a mismatch report as a table, or as an MCAP file with layouts."""

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


def export(
    source: Annotated[Path, typer.Argument(help="bag, or report folder of 'adk mismatch'")],
    to: Annotated[str, typer.Option(help="csv, parquet, mat or mcap")],
    out: Annotated[Path, typer.Option(help="file to write; with mcap: bag to write")],
    recording: Annotated[
        list[Path] | None,
        typer.Option(
            help="recording of the report, if it has been moved since (may be repeated)",
            show_default="as the report names it",
        ),
    ] = None,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    no_imu: NoImuOption = False,
    params: ParamsOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Export a bag or a mismatch report as a table or MCAP.

    A report gives measured, simulated and corrected signals with their residuals, side by side.
    With mcap, layouts for Foxglove and PlotJuggler are written next to the bag.

    Example: adk export bags/town --to csv --out town.csv
    """
    from adk_ros.api.exporting import export as run

    options = read_options(imu, odometry, command, no_imu, params)
    with console.stages() as progress:
        result = run(
            source,
            to,
            out,
            recording=recording or [],
            options=options,
            force=force,
            progress=progress,
        )
    console.warn_all(result.warnings)
    if as_json:
        console.print_json(result.as_dict())
        return
    kind = "messages" if to == "mcap" else "rows"
    console.note(f"{result.rows} {kind}, {len(result.columns)} channels in {out}")
    for layout in result.layouts:
        console.note(f"layout: {layout}")
