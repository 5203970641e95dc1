# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench concealed: how often `adk mismatch` is right."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.bench.mismatch.case_score import CaseResult


def concealed(
    cases: Annotated[
        Path | None, typer.Option(help="folder of cases, each with its label.json")
    ] = None,
    own: Annotated[
        bool, typer.Option("--own", help="make cases with the package's own plant instead")
    ] = False,
    real: Annotated[
        Path | None,
        typer.Option(help="folder of real recordings: take a known term away, ask for it back"),
    ] = None,
    vehicle: Annotated[
        Path | None, typer.Option(help="with --real: the car's masses and lengths, YAML")
    ] = None,
    limit: Annotated[int, typer.Option(help="with --own: this many, spread evenly; 0: all")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="folder to keep the reports in, one a case, the bars and the tables"),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="take the cases that --out has already as they are")
    ] = False,
    jobs: Annotated[int, typer.Option(help="cases at a time, of one thread each")] = 1,
    peers: Annotated[
        bool, typer.Option("--peers", help="run other methods on the same residuals (make peers)")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """
    Score `adk mismatch` on cases in which something is concealed.

    Prints a line PASS, FAIL or, where no case ran, NONE for each bar; a FAIL is a measurement,
    not an error.

    Example: adk bench concealed --cases cases
    """
    from adk_ros.bench.mismatch.acceptance import evaluate_criteria
    from adk_ros.bench.mismatch.baselines import Baselines
    from adk_ros.bench.mismatch.mismatch_bench import MismatchBench, generated_jobs, jobs_of
    from adk_ros.bench.mismatch.result_tables import as_json as content
    from adk_ros.bench.mismatch.result_tables import baseline_results, markdown, write_tables
    from adk_ros.files.output_folder import check_output_folder
    from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown

    if (cases is not None) + own + (real is not None) != 1:
        raise UsageError("give --cases FOLDER, --own or --real FOLDER, one of the three")
    if real is not None:
        _real(real, vehicle, as_json)
        return
    if not 1 <= jobs <= 64:
        raise UsageError(f"--jobs is {jobs}: choose 1 to 64")
    if resume and out is None:
        raise UsageError("--resume goes on from what is in --out FOLDER: name it")
    if out is not None:
        check_output_folder(out)
    todo = generated_jobs(limit) if cases is None else jobs_of(cases)
    try:
        with (
            graceful_shutdown(),
            tempfile.TemporaryDirectory() as folder,
            console.progress("cases") as bar,
        ):
            rivals = Baselines() if peers else None
            scores = MismatchBench(out or Path(folder), jobs, resume, rivals).run(todo, bar)
            bars = evaluate_criteria(scores)
            if out is not None:
                write_tables(scores, bars, out)
    except Terminated:
        console.note("adk: terminated")
        raise typer.Exit(TERMINATED) from None
    if as_json:
        console.print_json(content(scores, bars))
        return
    for s in scores:
        console.output.print(_line(s), markup=False)
    if peers:
        console.output.print(markdown(*baseline_results(scores)), markup=False, end="")
    for one in bars:
        console.output.print(str(one), markup=False)


def _real(folder: Path, vehicle: Path | None, as_json: bool) -> None:
    from dataclasses import asdict

    from adk_ros.bench.mismatch.ablation import ablation_criteria, run_ablation
    from adk_ros.bench.paper.av21 import find_recordings
    from adk_ros.mismatch.recording.from_bag import read_sensor_log
    from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle

    if vehicle is None:
        raise UsageError("--real needs --vehicle FILE: the car's masses and lengths")
    nominal = load_nominal_vehicle(vehicle)
    asked = []
    for bag in find_recordings(folder):
        with console.progress(f"reading {bag.name}") as bar:
            recording = read_sensor_log(bag, needs_imu=False, progress=bar)
        with console.progress("asking") as bar:
            asked += run_ablation(recording, nominal, bar)
    bars = ablation_criteria(asked)
    if as_json:
        console.print_json({
            "asked": [asdict(one) for one in asked], "bars": [asdict(bar) for bar in bars]
        })  # fmt: skip
        return
    for one in asked:
        best = f"; best single {one.best} takes {100.0 * one.gain:.1f} % off" if one.best else ""
        console.output.print(_line(one.score) + best, markup=False)
    for line in bars:
        console.output.print(str(line), markup=False)


def _line(s: CaseResult) -> str:
    """One case on one line."""
    parts = [f"{s.case}  {s.right:.2f}  {s.label}  ->  {s.reported}"]
    parts += [f"{name} off by {100.0 * x:.1f} %" for name, x in s.errors.items()]
    parts += [f"IoU {x:.2f}" for x in s.iou.values()]
    if s.removed:
        gone = ", ".join(f"{name} {100.0 * x:.0f} %" for name, x in s.removed.items())
        parts.append(f"removed {gone}")
    if math.isfinite(s.seconds):
        parts.append(f"{s.seconds:.0f} s, {s.cpu_s:.0f} s CPU, {s.memory_mib:.0f} MiB")
    if s.failure:
        parts.append(s.failure)
    return "; ".join(parts)
