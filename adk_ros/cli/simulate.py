# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk simulate: a scenario driven by the package's own simulator, as a bag."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption


def simulate(
    scenario: Annotated[str, typer.Argument(help="a scenario's name or YAML file")],
    out: Annotated[Path, typer.Option(help="bag to write")],
    model: Annotated[
        Path | None,
        typer.Option(help="car to drive instead: simulation.yaml or corrected.yaml of a mismatch"),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="instead of the scenario's own")] = None,
    duration: Annotated[float | None, typer.Option(help="seconds, instead of its own")] = None,
    storage: Annotated[str, typer.Option(help="mcap or sqlite3")] = "mcap",
    compression: Annotated[str | None, typer.Option(help="zstd, or none")] = "zstd",
    as_json: JsonOption = False,
) -> None:
    """
    Drive a simulated car and write what its sensors send as a bag.

    The car has fourteen degrees of freedom (seven in `handling` and `town`). Scenarios that come
    with it: handling, town, xyz_edges, mass_plus_160, mass_minus_170, inertia_plus_142,
    inertia_minus_158, mountain, slalom, winter, gusts, worn_tyres.

    Example: adk simulate mountain --out mountain
    """
    from adk_ros.mismatch.deployment.scenario_drive import (
        position_dependent_terms,
        simulate_scenario,
    )
    from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
    from adk_ros.offline.export import write_bag
    from adk_ros.plant.scenario.scenario_file import load_scenario
    from adk_ros.plant.scenario.simulate import simulate as run

    course = load_scenario(scenario)
    with console.progress("driving") as bar:
        if model is None:
            drive = run(course, seed, duration, bar)
        else:
            car = load_surrogate(model)
            drive = simulate_scenario(car, course, seed, duration, bar)
    if model is not None and position_dependent_terms(car.content):
        names = ", ".join(position_dependent_terms(car.content))
        console.warn(f"bound to places, and not on this road: {names}")
    with console.progress("writing") as bar:
        write_bag(drive, out, storage, None if compression == "none" else compression, bar)
    seconds = round((len(drive.stamp_ns) - 1) * 0.025, 3)
    if as_json:
        console.print_json(
            {
                "scenario": drive.name,
                "seed": drive.seed,
                "seconds": seconds,
                "messages": len(drive.readings),
                "out": str(out),
            }
        )
        return
    console.note(f"{seconds:.0f} s of {drive.name}, seed {drive.seed}: {out}")
