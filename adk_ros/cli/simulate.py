# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk simulate: a simulated drive as a bag."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import ForceOption, JsonOption


def simulate(
    scenario: Annotated[str, typer.Argument(help="name of a scenario, or its YAML file")],
    out: Annotated[Path, typer.Option(help="bag to write")],
    model: Annotated[
        Path | None,
        typer.Option(
            help="vehicle to drive instead of the scenario's: simulation.yaml or corrected.yaml "
            "written by 'adk mismatch'"
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(help="seed of route, driver and noise", show_default="the scenario's"),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="duration in s", show_default="the scenario's")
    ] = None,
    storage: Annotated[str, typer.Option(help="mcap or sqlite3")] = "mcap",
    compression: Annotated[str | None, typer.Option(help="zstd or none")] = "zstd",
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Simulate a drive and write its sensor messages as a bag.

    The built-in car has 14 degrees of freedom (7 in `handling` and `town`). Packaged scenarios:
    handling, town, xyz_edges, mass_plus_160, mass_minus_170, inertia_plus_142,
    inertia_minus_158, mountain, slalom, winter, gusts, worn_tyres. Takes a few seconds per
    simulated minute on an AMD EPYC, 2 cores.

    Example: adk simulate mountain --out mountain
    """
    from adk_ros.api.simulate import simulate as run

    with console.stages() as progress:
        result = run(
            scenario,
            out,
            model=model,
            seed=seed,
            duration_s=duration,
            storage=storage,
            compression=None if compression == "none" else compression,
            force=force,
            progress=progress,
        )
    console.warn_all(result.warnings)
    drive = result.drive
    if as_json:
        console.print_json(
            {
                "scenario": drive.name,
                "seed": drive.seed,
                "seconds": result.duration_s,
                "messages": len(drive.readings),
                "out": str(out),
            }
        )
        return
    console.note(f"{result.duration_s:.0f} s of {drive.name}, seed {drive.seed}: {out}")
