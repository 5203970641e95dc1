# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench paper: reproduce the paper's tables and figures, check its claims and the criteria."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import ForceOption, JsonOption
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.bench.paper.online_effect import Reading
    from adk_ros.bench.paper.training_jobs import BenchPlan

_QUICK_STEPS = 2000
_QUICK_EPOCHS, _QUICK_BATCH = 80, 256
_QUICK_STRIDE = 40


def paper(
    out: Annotated[Path, typer.Option(help="folder to write the report into")] = Path("paper_out"),
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="shorter training, fewer rollouts: up to 20 min on an AMD EPYC, 2 cores, instead "
            "of about 1 h",
        ),
    ] = False,
    seeds: Annotated[int, typer.Option(help="number of trainings, each with another seed")] = 3,
    steps: Annotated[
        int | None,
        typer.Option(
            help="training steps of the adk_ros model", show_default="4000; 2000 with --quick"
        ),
    ] = None,
    epochs: Annotated[
        int | None,
        typer.Option(
            help="training epochs of the paper's models: deep Koopman (DK), also with "
            "acceleration loss (ALDK)",
            show_default="200; 80 with --quick",
        ),
    ] = None,
    recordings: Annotated[
        Path | None, typer.Option(help="folder of real recordings to train and test on as well")
    ] = None,
    peers: Annotated[
        bool,
        typer.Option(
            help="also run the baseline libraries pykoop and pykoopman (needs `make peers`)"
        ),
    ] = True,
    test: Annotated[
        list[str] | None,
        typer.Option(
            help="run only this test and nominal (repeatable): mass_plus_160, mass_minus_170, "
            "inertia_plus_142, inertia_minus_158, mountain, slalom, winter, gusts or worn_tyres",
            show_default="all",
        ),
    ] = None,
    only_effect: Annotated[
        bool,
        typer.Option(
            "--only-effect",
            help="only examine on what the printed effect of the paper's online method depends: "
            "kind of error, window, cut of the pseudo-inverse, epochs",
        ),
    ] = False,
    device: Annotated[
        str, typer.Option(help="device to train DK and ALDK on: auto, cpu or cuda")
    ] = "cpu",
    checkpoints: Annotated[
        Path | None,
        typer.Option(
            help="folder for checkpoints of DK and ALDK: an interrupted training continues from "
            "there, a finished one is not repeated",
            show_default="none are kept",
        ),
    ] = None,
    jobs: Annotated[int, typer.Option(help="processes, one thread each")] = 2,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Reproduce the paper's tables, check its claims and compare all predictors.

    Prints PASS or FAIL for each acceptance criterion. The exit code is 0 even if one fails.

    Example: adk bench paper --quick
    """
    started = time.monotonic()
    from adk_ros.api.provenance import RunTimer
    from adk_ros.bench.paper.claims import counts
    from adk_ros.bench.paper.paper_bench import check, effect_plan, run_paper
    from adk_ros.bench.paper.paper_page import PAGE
    from adk_ros.files.output_folder import check_output_folder, refuse_existing
    from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown
    from adk_ros.train.train_settings import require_device

    timer = RunTimer()
    plan = _plan(quick, seeds, steps, epochs, recordings, peers, tuple(test or ()))
    require_device(device)
    plan = replace(plan, device=device, checkpoints=checkpoints)
    if only_effect:
        plan = effect_plan(plan)
    check(plan)
    if not 1 <= jobs <= 64:
        raise UsageError(f"--jobs is {jobs}: choose 1 to 64")
    refuse_existing(out, force, result_files=(PAGE, "online_effect.md"))
    check_output_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    try:
        with graceful_shutdown(), tempfile.TemporaryDirectory(prefix="adk_paper_") as folder:
            with console.progress("bench") as bar:
                result = run_paper(plan, Path(folder), jobs, bar, console.note)
            if only_effect:
                _show_effect(result.readings, out, as_json)
                return
            from adk_ros.bench.paper.paper_page import write_report

            sources = [("recording", path) for path in plan.recordings]
            provenance = timer.provenance(sources)
            report = write_report(result, plan, Path(folder), out, provenance=provenance)
    except Terminated:
        console.note("adk: terminated")
        raise typer.Exit(TERMINATED) from None
    seconds = time.monotonic() - started
    if as_json:
        console.print_json(
            {
                "criteria": [vars(item) for item in report.criteria],
                "claims": [
                    {"section": c.section, "claim": c.text, "verdict": c.verdict}
                    for c in report.claims
                ],
                "seconds": round(seconds, 1),
                "report": str(report.page),
            }
        )
        return
    for item in report.criteria:
        console.output.print(str(item), markup=False)
    console.flush()
    console.note(f"the paper's claims: {counts(report.claims)}")
    console.note(report.times.title)
    for row in [report.times.header, *report.times.rows]:
        console.note(f"  {row[0]:<34}" + "".join(f"{cell:>12}" for cell in row[1:]))
    console.note(f"done in {seconds:.0f} s: {report.page}")


def _show_effect(readings: list[Reading], out: Path, as_json: bool) -> None:
    """Print the readings of the paper's effect and write their table."""
    from adk_ros.bench.paper.effect_text import effect_tables, effect_text

    for table in effect_tables(readings):
        table.write(out)
    if as_json:
        console.print_json({"readings": [reading.as_json() for reading in readings]})
        return
    for text in effect_text(readings):
        console.output.print(text, markup=False)
    console.flush()
    console.note(f"{len(readings)} readings: {out / 'online_effect.md'}")


def _plan(
    quick: bool,
    seeds: int,
    steps: int | None,
    epochs: int | None,
    recordings: Path | None,
    peers: bool,
    tests: tuple[str, ...],
) -> BenchPlan:
    from adk_ros.bench.paper.av21 import find_recordings
    from adk_ros.bench.paper.cases import TESTS
    from adk_ros.bench.paper.training_jobs import BenchPlan
    from adk_ros.train.train_settings import TrainSettings

    plan = BenchPlan(quick=quick, seeds=seeds, tests=tests or TESTS, peers=peers)
    if quick:
        plan = replace(
            plan, train=replace(plan.train, steps=_QUICK_STEPS), paper_epochs=_QUICK_EPOCHS,
            paper_batch=_QUICK_BATCH, stride=_QUICK_STRIDE,
        )  # fmt: skip
    if steps is not None:
        every = min(TrainSettings().validate_every, max(1, steps // 10))
        plan = replace(plan, train=replace(plan.train, steps=steps, validate_every=every))
    if epochs is not None:
        if not 1 <= epochs <= 10**6:
            raise UsageError(f"--epochs is {epochs}: choose 1 to 1000000")
        plan = replace(plan, paper_epochs=epochs)
    if recordings is not None:
        if not recordings.is_dir():
            raise UsageError(f"--recordings {recordings} is not a folder")
        plan = replace(plan, recordings=find_recordings(recordings))
    return plan
