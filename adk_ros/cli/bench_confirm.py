# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench confirm: compare all predictors on drives that are drawn after the code is fixed."""

from __future__ import annotations

import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import ForceOption, JsonOption
from adk_ros.errors import UsageError

_QUICK_STEPS, _QUICK_STRIDE = 1000, 40
_EPOCHS = 90
"""Of the paper's model, by which its loss has settled (`adk bench paper` takes 200)."""


def confirm(
    out: Annotated[Path, typer.Option(help="folder to write the results into")] = Path(
        "confirmation_out"
    ),
    seed: Annotated[
        str,
        typer.Option(
            help="any text that the drives are drawn from", show_default="hash of the code"
        ),
    ] = "",
    tests: Annotated[
        int,
        typer.Option(
            help="number of test drives besides the nominal one and two in other simulators, "
            "3 to 200"
        ),
    ] = 12,
    trainings: Annotated[int, typer.Option(help="number of trainings, 1 to 100")] = 3,
    quick: Annotated[
        bool, typer.Option("--quick", help="one short training and short drives: to try it out")
    ] = False,
    peers: Annotated[
        bool,
        typer.Option(
            help="also run the baseline libraries pykoop and pykoopman (needs `make peers`)"
        ),
    ] = True,
    single_track: Annotated[
        bool,
        typer.Option("--single-track", help="train with it, see `adk train --single-track`"),
    ] = False,
    sources: Annotated[
        bool,
        typer.Option(
            "--sources",
            help="also show where the errors come from: rows without windowed least squares, of "
            "the offline model with its observer alone, and of the plant from the estimated state",
        ),
    ] = False,
    jobs: Annotated[int, typer.Option(help="processes, one thread each")] = 2,
    resume: Annotated[
        bool, typer.Option("--resume", help="continue an interrupted run of the same code")
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Compare all predictors on drives that are drawn after the code is fixed.

    Roads, speeds, cars and noise come from the hash of the package's code, so that nothing can be
    chosen on them: other code has other drives. Takes 16 to 60 min on two cores. Prints PASS or
    FAIL for each criterion; the exit code is 0 even if one fails.

    Example: adk bench confirm --out confirmation_out
    """
    started = time.monotonic()
    from adk_ros.bench.paper import cases
    from adk_ros.bench.paper.confirmation_drives import (
        MAX_TESTS,
        MIN_TESTS,
        write_confirmation_drives,
    )
    from adk_ros.bench.paper.confirmation_report import PAGE, write_confirmation
    from adk_ros.bench.paper.other_simulators import DESCRIPTIONS
    from adk_ros.bench.paper.outcome_store import OutcomeStore
    from adk_ros.bench.paper.paper_bench import check, run_paper
    from adk_ros.bench.paper.training_jobs import BenchPlan
    from adk_ros.bench.vehicles.multibody import MULTI_BODY, is_installed
    from adk_ros.files.code_digest import code_digest
    from adk_ros.files.output_folder import check_output_folder, refuse_existing
    from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown
    from adk_ros.train.train_settings import TrainSettings

    if not MIN_TESTS <= tests <= MAX_TESTS:
        raise UsageError(f"--tests is {tests}: choose {MIN_TESTS} to {MAX_TESTS}")
    if not 1 <= jobs <= 64:
        raise UsageError(f"--jobs is {jobs}: choose 1 to 64")
    refuse_existing(out, force, result_files=(PAGE,))
    check_output_folder(out)
    digest = code_digest()
    chosen = seed or digest
    others = [name for name in DESCRIPTIONS if name != MULTI_BODY or is_installed()]
    if MULTI_BODY not in others:
        console.note(f"without {MULTI_BODY}: it needs `pip install commonroad-vehicle-models`")
    folder = out.with_name(f"{out.name}.part")
    key = (
        f"{digest} {chosen} {tests} {trainings} {quick} {peers} {others} {single_track} {sources}"
    )
    store = OutcomeStore.opened(folder, key, resume)
    shutil.rmtree(folder / "scenarios", ignore_errors=True)
    try:
        with graceful_shutdown():
            with console.progress("drawing drives") as bar:
                drives = write_confirmation_drives(
                    folder / "scenarios", chosen, tests, bar, others
                )
            settings = TrainSettings(single_track=single_track)
            plan = BenchPlan(
                train=settings, quick=quick, seeds=1 if quick else trainings, tests=drives.tests,
                drives=drives, left_out=("dk", "effect", "recording"), peers=peers,
                paper_epochs=_EPOCHS, sources=sources,
            )  # fmt: skip
            if quick:
                plan = replace(
                    plan, left_out=(*plan.left_out, "aldk", "tuned"),
                    train=replace(settings, steps=_QUICK_STEPS), stride=_QUICK_STRIDE,
                    durations=cases.Durations(300.0, 40.0),
                )  # fmt: skip
            check(plan)
            with console.progress("confirmation drives") as bar:
                result = run_paper(plan, folder, jobs, bar, console.note, store)
            criteria = write_confirmation(result, plan, folder / "scenarios", out, digest, chosen)
    except (Terminated, KeyboardInterrupt) as stop:
        console.note(f"finished jobs are kept in {folder}: --resume continues")
        if isinstance(stop, KeyboardInterrupt):
            raise
        raise typer.Exit(TERMINATED) from None
    shutil.rmtree(folder)
    seconds = time.monotonic() - started
    if as_json:
        console.print_json(
            {
                "code": digest, "seed": chosen, "seconds": round(seconds, 1),
                "criteria": [vars(item) for item in criteria],
            }
        )  # fmt: skip
        return
    for item in criteria:
        console.output.print(str(item), markup=False)
    console.flush()
    console.note(f"code {digest[:16]}, done in {seconds:.0f} s: {out / PAGE}")
