# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench real: what is said of real recordings of which something is known."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adk_ros.bench.real.outcome import Score
    from adk_ros.bench.real.real_bench import RealBench
    from adk_ros.bench.real.real_predictions import RatioOutcome


def real(
    recordings: Annotated[
        Path, typer.Option(help="folder of rosbag2 recordings, in a folder for each vehicle")
    ],
    development: Annotated[
        bool,
        typer.Option(
            "--development", help="sizes with which the method was developed, not the others"
        ),
    ] = False,
    part: Annotated[
        list[str] | None,
        typer.Option(
            help="answers, faults, terms, conditions, slopes or predictions (repeatable): run "
            "this part only",
            show_default="all of them",
        ),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="trainings of each model (predictions)")] = 1,
    out: Annotated[
        Path | None, typer.Option(help="file for the results, one JSON object a line")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """
    Score what is said and predicted of real recordings.

    answers: what `adk info`, `adk check` and, with a vehicle.yaml (mass, wheelbase) in the
    vehicle's folder, `adk mismatch --simulation vehicle.yaml` say of each recording. None may be
    refused that has 20 s of driving. Takes 1 to 4 min a recording.

    faults: injected into sensors and steering; `adk check --reference` must name them. The
    reference is untouched: the first half of the same recording, or another one of the same
    vehicle. Takes about 15 s a minute of driving.

    terms: removed from a model of the car that is calibrated on the first 60 % of a recording;
    `adk mismatch` must name them on the rest. The recording is read with the parameters that
    `adk check` proposes. Needs a vehicle.yaml (mass, wheelbase) in the vehicle's folder. Takes
    1 to 5 min a recording.

    conditions: tyres, a load or the surface changed between two recordings; `adk mismatch` must
    name what has changed, with a model that is calibrated on the first one as the simulation. The
    vehicle's folder needs a vehicle.yaml and a conditions.yaml, which lists the pairs. Takes 1 to
    2 min a pair.

    slopes: the attitude of a navigation system is withheld; `adk check` must find the grade.

    predictions: trained on the first 60 % of each recording, tested on the rest and on the other
    recordings of the vehicle, against the naive predictors. Takes 1 to 2 min a recording and seed.

    Example: adk bench real --recordings recordings --out faults.jsonl
    """
    from adk_ros.bench.paper.training_jobs import BenchPlan
    from adk_ros.bench.real import fault_cases, scores
    from adk_ros.bench.real.real_bench import PARTS, bench_real

    if out is not None and not out.absolute().parent.is_dir():
        raise UsageError(f"--out {out}: the folder does not exist")
    selected = part or PARTS
    for name in selected:
        if name not in PARTS:
            raise UsageError(f"--part {name}: choose {', '.join(PARTS)}")
    sizes = fault_cases.DEVELOPMENT if development else fault_cases.CONFIRMATION
    with console.progress("comparing recordings") as bar:
        result = bench_real(recordings, sizes, bar, selected, BenchPlan(seeds=seeds))
    if out is not None:
        rows = [x.as_dict() for x in result.outcomes]
        rows += [x.as_dict() for x in result.terms]
        rows += [x.as_dict() for x in result.conditions]
        rows += [x.as_dict() for x in result.slopes]
        rows += [x.as_dict() for x in result.predictions]
        rows += [x.as_dict() for x in result.answers]
        lines = [json.dumps(row) for row in rows]
        out.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    if as_json:
        console.print_json(scores.as_dict(result))
        return
    _print(result)


def _print(result: RealBench) -> None:
    from adk_ros.bench.real import scores
    from adk_ros.bench.real.outcome import scores_by

    for answer in result.answers:
        said = f"refused: {answer.text}" if answer.is_refused else answer.text
        text = f"{answer.vehicle}, {answer.recording}, {answer.command}: {said}"
        console.output.print(text, markup=False)
    injected = scores.faults(result)
    if injected:
        _print_scores("fault", "not decidable", scores_by(injected, lambda x: x.fault))
        by_vehicle = scores_by(injected, lambda x: f"{x.vehicle}, {x.kind}")
        _print_scores("vehicle", "not decidable", by_vehicle)
    if result.terms:
        rows = scores_by(result.terms, lambda x: x.term or "nothing")
        _print_scores("removed term", "unknown", rows)
    for pair in result.conditions:
        right = "named" if pair.is_named else "not named" if pair.effects else "nothing changed"
        text = f"{pair.vehicle}, {pair.recording}: {pair.change} ({right}): {pair.sentence}"
        console.output.print(text, markup=False)
    for slope in result.slopes:
        text = f"{slope.vehicle}, {slope.recording}: {slope.slope} without attitude correlates "
        text += f"{slope.correlation:.3f} with it, scale {slope.scale:.2f}, RMS {slope.spread:.1%}"
        if slope.v_x_error:
            none, withheld, used = slope.v_x_error
            text += (
                f"; v_x after 1 s is off by {none:.3f} m/s without a slope, {withheld:.3f} with "
                f"the attitude withheld, {used:.3f} with it"
            )
        console.output.print(text, markup=False)
    if result.predictions:
        _print_ratios(result.predictions)
    clean = scores.untouched(result)
    if clean:
        console.output.print(f"untouched comparisons: {len(clean)}", markup=False)
    for outcome in clean:
        said = ", ".join(outcome.false_claims) or "nothing changed"
        console.output.print(f"  {outcome.vehicle}, {outcome.recording}: {said}", markup=False)
    for text in result.refused:
        console.output.print(f"not used: {text}", markup=False)
    for place, faults in result.left_out.items():
        if faults:
            text = f"not in the channels of {place}: {', '.join(faults)}"
            console.output.print(text, markup=False)
    for criterion in scores.criteria(result):
        if not criterion.cases:
            continue
        text = f"{criterion.verdict}  {criterion.name}: {criterion.figure:.3g}, {criterion.limit}"
        console.output.print(text, markup=False)
    console.flush()


def _print_scores(title: str, left_open: str, rows: Sequence[Score]) -> None:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    table.add_column(title, no_wrap=True)
    for heading in (
        "cases", "named", "only candidate", "median error", "in 90 % interval", "other claims",
        left_open,
    ):  # fmt: skip
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(
            row.group,
            str(row.cases),
            f"{row.named:.0%}",
            f"{row.alone:.0%}",
            "" if row.median_error is None else f"{row.median_error:.1%}",
            "" if row.inside is None else f"{row.inside:.0%}",
            str(row.false_claims),
            f"{row.left_open:.0%}",
        )
    console.print_table(table)


def _print_ratios(rows: Sequence[RatioOutcome]) -> None:
    from rich import box
    from rich.table import Table

    from adk_ros.bench.real.real_predictions import HORIZONS_S

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    for heading in ("trained on", "tested on", "channel", "commands"):
        table.add_column(heading)
    for horizon_s in HORIZONS_S:
        table.add_column(f"{horizon_s:g} s", justify="right")
    for row in rows:
        tested = "its rest" if row.is_own else row.tested_on
        ratios = (f"{ratio:.2f}" for ratio in row.mean)
        table.add_row(row.trained_on, tested, row.channel, row.commands, *ratios)
    console.print_table(table)
