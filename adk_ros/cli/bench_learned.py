# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench learned: learned vehicle models of other authors, trained by their own code."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.bench.learned.learned_bench import RecordingResult

_CHANNELS = ("v_x", "v_y", "yaw rate")


def learned(
    recordings: Annotated[
        Path, typer.Option(help="folder of recordings with pedal and odometry at 25 Hz")
    ],
    code: Annotated[
        Path, typer.Option(help="folder with the authors' repositories: deep-dynamics, FTHD")
    ],
    python: Annotated[
        Path | None,
        typer.Option(help="Python with what their code imports", show_default="this one"),
    ] = None,
    model: Annotated[
        list[str] | None,
        typer.Option(
            help="run only this model (repeatable): 'Deep Dynamics', 'Deep Pacejka', FTHD, or "
            "'Deep Pacejka, future v_x given'",
            show_default="all but the last",
        ),
    ] = None,
    seeds: Annotated[int, typer.Option(help="number of trainings, each with another seed")] = 3,
    epochs: Annotated[
        list[str] | None,
        typer.Option(
            help="training epochs, of all or of one model as NAME=N (repeatable)",
            show_default="the published ones",
        ),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(help="training steps of adk_ros", show_default="4000")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="JSON file for the results, written after each training")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """
    Compare with learned vehicle models on recordings: Deep Dynamics, Deep Pacejka, FTHD.

    Their own code trains them on the first 60 % of each recording; all predict the rest from the
    same samples, with known commands. Runs that code, so check it out from a source you trust.

    Example: adk bench learned --recordings recordings --code peers
    """
    from adk_ros.bench.learned import scores
    from adk_ros.bench.learned.learned_bench import plan_of, run_learned
    from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown

    plan = replace(
        plan_of(recordings, code), python=python, models=tuple(model or ()), seeds=seeds,
        epochs=_epochs(epochs or ()),
    )  # fmt: skip
    if steps is not None:
        if steps < 1:
            raise UsageError(f"--steps is {steps}: choose 1 or more")
        every = min(plan.train.validate_every, max(1, steps // 10))
        plan = replace(plan, train=replace(plan.train, steps=steps, validate_every=every))
    if out is not None and not out.absolute().parent.is_dir():
        raise UsageError(f"--out {out}: the folder does not exist")

    def keep(so_far: list[RecordingResult]) -> None:
        if out is not None:
            out.write_text(json.dumps(scores.as_dict(so_far)), encoding="utf-8")

    try:
        with (
            graceful_shutdown(),
            tempfile.TemporaryDirectory(prefix="adk_learned_") as scratch,
            console.progress("training") as bar,
        ):
            results = run_learned(plan, Path(scratch), bar, keep)
    except Terminated:
        console.note("adk: terminated")
        raise typer.Exit(TERMINATED) from None
    if as_json:
        console.print_json(scores.as_dict(results))
        return
    for result in results:
        _print(result)
    for item in scores.criteria(results):
        verdict = "PASS" if item.is_met else "FAIL"
        text = f"{verdict}  {item.name}: {item.figure:.1%} of the combinations, {item.limit}"
        console.output.print(text, markup=False)
    console.flush()


def _epochs(given: Sequence[str]) -> dict[str, int]:
    from adk_ros.bench.learned.learned_models import PACKAGES

    found: dict[str, int] = {}
    for text in given:
        name, _, number = text.rpartition("=")
        if not number.isdecimal() or int(number) < 1 or name not in ("", *PACKAGES):
            raise UsageError(f"--epochs {text}: give a number, or NAME=N with a model's name")
        found |= dict.fromkeys([name] if name else PACKAGES, int(number))
    return found


def _print(result: RecordingResult) -> None:
    from rich import box
    from rich.table import Table

    from adk_ros.bench.learned.learned_bench import HORIZONS_S
    from adk_ros.bench.learned.scores import ratio_rows

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    table.add_column("RMSE / best naive", no_wrap=True)
    table.add_column("channel", no_wrap=True)
    for horizon in HORIZONS_S:
        table.add_column(f"{horizon:g} s", justify="right")
    for channel, label in enumerate(_CHANNELS):
        for name, values in ratio_rows(result, channel):
            table.add_row(name, label, *(f"{value:.3g}" for value in values))
    console.output.print(f"{result.name}, {result.count} starts", markup=False)
    console.print_table(table)
    for name, efforts in result.effort.items():
        train, step, rollout = (
            sum(getattr(e, part) for e in efforts) / len(efforts)
            for part in ("train_s", "step_s", "rollout_s")
        )
        console.output.print(
            f"  {name}: training {train:.0f} s, one step {1e3 * step:.3g} ms, "
            f"2 s ahead {1e3 * rollout:.3g} ms",
            markup=False,
        )
    for items in result.trainings.values():
        for item in items:
            console.output.print(
                f"  {item.model}: {item.settings}, {len(item.losses)} epochs, smallest validation"
                f" loss {item.losses.min():.3g} at {item.best_epoch}, within 5 % of it from"
                f" {item.converged_epoch} on",
                markup=False,
            )
