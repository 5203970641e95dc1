# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk fleet mismatch, compare and demo: what a fleet says about its simulation."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from adk_ros.cli.options import (
    CommandOption,
    ImuOption,
    JsonOption,
    OdometryOption,
    ParamsOption,
    RecordingParamsOption,
    options_of_recordings,
    read_options,
)
from adk_ros.errors import UsageError
from adk_ros.fleet.report.file_names import DATA

if TYPE_CHECKING:
    from adk_ros.api.fleet.fleet_mismatch import FleetMismatch
    from adk_ros.api.fleet.fleet_run import FleetOptions
    from adk_ros.bags.recording import RecordingOptions


def mismatch(
    recordings: RecordingsArgument,
    simulation: Annotated[Path, typer.Option(help="bag of the simulator")],
    out: OutOption,
    vehicle: Annotated[
        Path | None,
        typer.Option(help="vehicle file of the simulated car: YAML or packaged name"),
    ] = None,
    further_simulation: Annotated[
        list[Path] | None,
        typer.Option(
            help="another bag of the simulator, driven on roads of the fleet (repeatable): small "
            "effects of all cars need it",
        ),
    ] = None,
    without_imu: Annotated[
        bool, typer.Option("--without-imu", help="accept recordings without an IMU")
    ] = False,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    params: ParamsOption = None,
    recording_params: RecordingParamsOption = None,
    tags: TagsOption = None,
    workers: WorkersOption = None,
    cluster: ClusterOption = None,
    timeout: TimeoutOption = 1800.0,
    memory: MemoryOption = 4096.0,
    limit: Annotated[
        int | None,
        typer.Option(
            help="analyse so many recordings, chosen by the hash of their names",
            show_default="all",
        ),
    ] = None,
    retry_failed: RetryOption = False,
    reports: Annotated[
        int,
        typer.Option(
            help="recordings that get a report as of 'adk mismatch', those explained worst; the "
            "page links all reports that exist"
        ),
    ] = 5,
    dry_run: DryRunOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Find what the simulation lacks by the evidence of all recordings, and whose fault it is.

    All cars (the simulator), one car, a condition of fleet.csv, a place, or from a time on. Writes
    report/fleet.html and corrected models; continues an interrupted run.

    Example: adk fleet mismatch drives --simulation sim --vehicle vehicle.yaml --out fleet
    """
    simulated_with = read_options(imu, odometry, command, False, params)
    reading = options_of_recordings(simulated_with, recording_params)
    options = fleet_options(tags, workers, cluster, timeout, memory, limit, retry_failed)
    if dry_run:
        from adk_ros.api.fleet.mismatch_estimate import estimate_mismatch
        from adk_ros.fleet.inference.analysis import USUAL_PASSES

        estimate = estimate_mismatch(
            simulation, recordings, out, vehicle, further_simulations=further_simulation or (),
            without_imu=without_imu, recording_options=reading,
            simulation_options=simulated_with, options=options,
        )  # fmt: skip
        print_estimate(
            estimate.as_dict(), as_json, f" (counts of the first of about {USUAL_PASSES} passes)"
        )
        return
    found = _analysed(
        simulation, recordings, out, vehicle, without_imu, options, reports, reading,
        simulated_with, further_simulation or (),
    )  # fmt: skip
    if as_json:
        console.print_json(json.loads((found.page.parent / DATA).read_text(encoding="utf-8")))
        return
    _show(found)


def compare(
    before: Annotated[Path, typer.Argument(help="folder of an earlier 'adk fleet mismatch'")],
    after: Annotated[Path, typer.Argument(help="folder of a later one")],
    out: Annotated[Path, typer.Option(help="folder for the page")],
) -> None:
    """
    Compare two fleet results, such as before and after an update of the simulator.

    Example: adk fleet compare fleet_old fleet_new --out comparison
    """
    from adk_ros.api.fleet.fleet_mismatch import REPORT
    from adk_ros.fleet.report.fleet_comparison import write_comparison

    contents = []
    for folder in (before, after):
        path = folder / REPORT / DATA
        try:
            contents.append(json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError):
            raise UsageError(
                f"{folder} has no result of 'adk fleet mismatch' ({path} cannot be read)"
            ) from None
    out.mkdir(parents=True, exist_ok=True)
    console.output.print(
        str(write_comparison(contents[0], contents[1], out, names=(str(before), str(after)))),
        markup=False,
    )


def demo(
    out: Annotated[Path, typer.Option(help="new folder for the fleet and its results")],
    seed: Annotated[int, typer.Option(help="another fleet for each number")] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="8 cars and 48 short drives instead of 12 and 200")
    ] = False,
    workers: WorkersOption = None,
) -> None:
    """
    Simulate a fleet with known faults, analyse it, and compare the result with the truth.

    Example: adk fleet demo --out demo_fleet --quick
    """
    from adk_ros.api.fleet.fleet_demo import compared_with_truth, read_truth, write_demo_fleet

    options = fleet_options(None, workers, None, 1800.0, 4096.0, None, False)
    if not (out / "truth.json").exists():
        with console.progress("simulating the fleet") as report:
            write_demo_fleet(out, seed, quick, report, options.workers)
    truth = read_truth(out / "truth.json", seed, quick)
    found = _analysed(
        out / "simulation", [str(out / "drives")], out / "fleet", out / "vehicle.yaml", False,
        options, further=sorted((out / "simulation_routes").iterdir()),
    )  # fmt: skip
    _show(found)
    comparison = compared_with_truth(found.result, truth)
    for line in (*comparison.lines, comparison.summary):
        console.output.print(line, markup=False)


def _analysed(
    simulation: Path,
    recordings: list[str],
    out: Path,
    vehicle: Path | None,
    without_imu: bool,
    options: FleetOptions,
    reports: int = 5,
    reading: RecordingOptions | None = None,
    simulated_with: RecordingOptions | None = None,
    further: Sequence[Path] = (),
) -> FleetMismatch:
    from adk_ros.api.fleet.fleet_mismatch import fleet_mismatch

    with continued_later(), console.progress("fleet") as report:
        return fleet_mismatch(
            simulation, recordings, out, vehicle, further_simulations=further,
            without_imu=without_imu, recording_options=reading,
            simulation_options=simulated_with, reports=reports, options=options, progress=report,
        )  # fmt: skip


def _show(found: FleetMismatch) -> None:
    """Print the summary, what could not be used, and where the page is."""
    console.output.print(found.summary, markup=False)
    recordings = found.result.recordings
    if len(recordings) > 1 and all(each.car == each.name for each in recordings):
        console.note(
            f"no vehicle is named (fleet.csv): {len(recordings)} recordings count as as many cars"
        )
    console.note_all(found.notes)
    if found.left:
        console.note(f"--limit: {found.left} recordings are not analysed")
    for name, reason in found.failed:
        console.output.print(f"not used: {name}: {reason}", markup=False)
    for each in recordings:
        if each.note:
            text = f"taken from an earlier pass: {each.name}: {each.note}"
            console.output.print(text, markup=False)
    console.flush()
    console.note(f"report: {found.page}")
