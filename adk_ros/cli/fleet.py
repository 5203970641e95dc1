# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk fleet: process all recordings of a test fleet."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.fleet_mismatch import compare, demo, mismatch
from adk_ros.cli.fleet_options import (
    ClusterOption,
    DryRunOption,
    LimitOption,
    MemoryOption,
    OutOption,
    RecordingsArgument,
    RetryOption,
    TagsOption,
    TimeoutOption,
    WorkersOption,
    fleet_options,
)
from adk_ros.cli.fleet_replay import print_replay
from adk_ros.cli.fleet_run import continued_later, print_estimate
from adk_ros.cli.fleet_train import train
from adk_ros.cli.options import (
    CommandOption,
    ImuOption,
    JsonOption,
    OdometryOption,
    ParamsOption,
    read_options,
)
from adk_ros.errors import DataError, UsageError

if TYPE_CHECKING:
    from adk_ros.api.fleet.fleet_run import FleetOptions
    from adk_ros.api.fleet.replay_summary import ReplaySummary
    from adk_ros.fleet.run import RunSummary
    from adk_ros.fleet.stage import Stage

app = typer.Typer(
    help="Process all recordings of a test fleet.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


def _run(
    stage: Stage,
    recordings: list[str],
    out: Path,
    options: FleetOptions,
    dry_run: bool,
    as_json: bool,
    result: Callable[[], ReplaySummary] | None = None,
) -> None:
    """Run a stage, or say what a run would do, and print the outcome and what `result` returns."""
    from adk_ros.api.fleet.fleet_run import estimate_fleet, run_fleet

    if dry_run:
        estimate = estimate_fleet(stage, recordings, out, options).as_dict()
        hint = ": --limit 2 measures it" if estimate["seconds"] is None else ""
        print_estimate(estimate, as_json, hint)
        return
    with continued_later(), console.progress("fleet") as report:
        summary = run_fleet(stage, recordings, out, options, report)
    found = None if result is None else result()
    if as_json:
        console.print_json(vars(summary) | ({} if found is None else found.as_dict()))
        return
    if found is not None:
        print_replay(found)
    _print_summary(stage, summary, out)


def _print_summary(stage: Stage, summary: RunSummary, out: Path) -> None:
    from adk_ros.fleet.run import duration_text

    text = f"{stage.name}: {summary.total} recordings, {summary.reused} done before"
    if summary.computed:
        text += f", {summary.computed} processed in {duration_text(summary.seconds)}"
        text += f", at most {summary.memory_mib:.0f} MiB each"
    if summary.left:
        text += f", {summary.left} left"
    if summary.failures:
        failed = ", ".join(f"{count} {kind}" for kind, count in summary.failures.items())
        text += f"; failed: {failed} ('adk fleet report {out}' says why)"
    console.output.print(text, markup=False)
    console.note_all(summary.notes)
    console.note(f"results in {out / 'results'}")


def _seen_by_workers(vehicle: Path | None) -> str:
    """Return the path of a vehicle file from any folder, or a packaged name; "" for None."""
    if vehicle is None:
        return ""
    return str(vehicle.resolve() if vehicle.exists() else vehicle)


@app.command()
def index(
    recordings: RecordingsArgument,
    out: OutOption,
    vehicle: Annotated[
        Path | None, typer.Option(help="vehicle file (YAML or packaged name) for the checks")
    ] = None,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    params: ParamsOption = None,
    tags: TagsOption = None,
    workers: WorkersOption = None,
    cluster: ClusterOption = None,
    timeout: TimeoutOption = 1800.0,
    memory: MemoryOption = 4096.0,
    limit: LimitOption = None,
    retry_failed: RetryOption = False,
    dry_run: DryRunOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Say which recordings are there, which are usable for what, and what their checks find.

    As 'adk info' and 'adk check', for each recording. A damaged recording is a row with a reason.

    Example: adk fleet index drives --out fleet
    """
    from adk_ros.api.fleet.index_stage import IndexStage

    options = fleet_options(tags, workers, cluster, timeout, memory, limit, retry_failed)
    reading = read_options(imu, odometry, command, False, params)
    stage = IndexStage(_seen_by_workers(vehicle), reading)
    _run(stage, recordings, out, options, dry_run, as_json)


@app.command()
def replay(
    recordings: RecordingsArgument,
    model: Annotated[Path, typer.Option(help="model folder written by 'adk train'")],
    out: OutOption,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    params: ParamsOption = None,
    tags: TagsOption = None,
    workers: WorkersOption = None,
    cluster: ClusterOption = None,
    timeout: TimeoutOption = 1800.0,
    memory: MemoryOption = 4096.0,
    limit: LimitOption = None,
    retry_failed: RetryOption = False,
    dry_run: DryRunOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Score a model on all recordings: errors by channel, horizon and condition, surprising minutes.

    Example: adk fleet replay drives --model model --out fleet
    """
    from adk_ros.api.fleet.fleet_run import listed_recordings
    from adk_ros.api.fleet.replay_stage import ReplayStage
    from adk_ros.api.fleet.replay_summary import replay_summary
    from adk_ros.model.stored_model import inspect_model

    sensors = inspect_model(model)["training"].get("sensors")
    reading = read_options(imu, odometry, command, False, params, sensors)
    options = fleet_options(tags, workers, cluster, timeout, memory, limit, retry_failed)
    stage = ReplayStage(str(model.resolve()), reading)

    def summary() -> ReplaySummary:
        found, _ = listed_recordings(recordings, options)
        return replay_summary(out, stage, found)

    _run(stage, recordings, out, options, dry_run, as_json, summary)


@app.command()
def explain(
    recordings: RecordingsArgument,
    simulation: Annotated[
        Path,
        typer.Option(help="bag of the simulator, or its vehicle file, as for 'adk mismatch'"),
    ],
    out: OutOption,
    vehicle: Annotated[
        Path | None,
        typer.Option(help="vehicle file of the simulated car: YAML or packaged name"),
    ] = None,
    without_imu: Annotated[
        bool, typer.Option("--without-imu", help="accept recordings without an IMU")
    ] = False,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    params: ParamsOption = None,
    tags: TagsOption = None,
    workers: WorkersOption = None,
    cluster: ClusterOption = None,
    timeout: TimeoutOption = 1800.0,
    memory: MemoryOption = 4096.0,
    limit: LimitOption = None,
    retry_failed: RetryOption = False,
    dry_run: DryRunOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Find which physics the simulation lacks by each recording on its own, as 'adk mismatch' does.

    Example: adk fleet explain drives --simulation sim --vehicle vehicle.yaml --out fleet
    """
    from adk_ros.api.fleet.explain_stage import ExplainStage

    if not simulation.exists():
        raise UsageError(f"--simulation {simulation} does not exist")
    options = fleet_options(tags, workers, cluster, timeout, memory, limit, retry_failed)
    reading = read_options(imu, odometry, command, False, params)
    stage = ExplainStage(
        str(simulation.resolve()), _seen_by_workers(vehicle), without_imu, reading
    )
    _run(stage, recordings, out, options, dry_run, as_json)


@app.command()
def report(
    out: Annotated[Path, typer.Argument(help="folder of the results")],
    as_json: JsonOption = False,
) -> None:
    """
    Summarise the results: recordings, failures with reasons, findings by number of recordings.

    Writes the page of 'adk fleet mismatch' again from its result, without analysis.

    Example: adk fleet report fleet
    """
    from adk_ros.api.fleet.results import fleet_summary

    summary = fleet_summary(out)
    if as_json:
        console.print_json(summary)
        _rewrite_page(out)
        return
    for stage in summary:
        failed = sum(stage["failed"].values())
        same = stage["recordings"] - stage["contents"]
        copies = f", {same} of them copies of others, or their old names" if same else ""
        console.output.print(
            f"{stage['stage']}: {stage['recordings']} recordings{copies}, {failed} failed",
            markup=False,
        )
        for name, reason in stage["reasons"].items():
            console.output.print(f"  failed: {name}: {reason}", markup=False)
        for kind, finding, count in stage["findings"]:
            console.output.print(f"  {kind}: {finding}: {count} recordings", markup=False)
    if page := _rewrite_page(out):
        console.output.print(f"page of 'adk fleet mismatch': {page}", markup=False)


def _rewrite_page(out: Path) -> Path | None:
    """Return the page of 'adk fleet mismatch', written again if its result is there."""
    from adk_ros.api.fleet.fleet_mismatch import REPORT
    from adk_ros.api.fleet.stored_report import rewrite_report
    from adk_ros.fleet.report.file_names import PAGE

    page = out / REPORT / PAGE
    try:
        rewrite_report(out)
    except (DataError, UsageError) as error:
        # While another run works in the folder, where it cannot be written, or by another version.
        console.note(f"the page is not written again: {error}")
    return page if page.is_file() else None


app.command()(train)
app.command()(mismatch)
app.command()(compare)
app.command()(demo)
