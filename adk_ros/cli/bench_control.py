# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench control: predictive controllers in closed loop, by prediction model."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.bench.control.control_bench import ControlPlan
    from adk_ros.bench.control.scores import ScoredRun

_QUICK_M = 60.0
_VERDICTS = {True: "PASS", False: "FAIL", None: "-   "}


def control(
    model: Annotated[
        Path | None,
        typer.Option(help="model folder", show_default="train one on the nominal car, 5 min"),
    ] = None,
    seed: Annotated[
        list[int] | None,
        typer.Option(
            help="seed of driver, sensor noise and sampling (repeatable: three show chance)",
            show_default="1",
        ),
    ] = None,
    manoeuvre: Annotated[
        list[str] | None,
        typer.Option(
            help="run only this one (repeatable): 'double lane change' or lap", show_default="both"
        ),
    ] = None,
    car: Annotated[
        list[str] | None,
        typer.Option(help="run only this car (repeatable), as in the table", show_default="all"),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="the first 60 m, a short training, and no plant as a model: minutes"
        ),
    ] = False,
    jobs: Annotated[int, typer.Option(help="runs in parallel; for times per cycle choose 1")] = 1,
    tune: Annotated[
        bool,
        typer.Option(
            "--tune", help="instead compare the controllers' parameters on the development set"
        ),
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="folder for JSON, CSV and figures; must not exist")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """
    MPPI and linear MPC in closed loop with our model, bicycle models and the plant itself.

    On the simulated car with 14 degrees of freedom: nominal, and changed without the planner
    knowing. Takes about an hour per seed, most of it for the plant as the prediction model.

    Example: adk bench control --quick
    """
    from adk_ros.bench.control.cars import CARS
    from adk_ros.bench.control.control_bench import (
        ControlPlan,
        as_dict,
        run_control,
        write_results,
    )
    from adk_ros.bench.control.linear_mpc import INSTALL, has_osqp
    from adk_ros.bench.control.reference_path import MANOEUVRES
    from adk_ros.bench.control.scores import MODELS, PLANT
    from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown

    if not 1 <= jobs <= 64:
        raise UsageError(f"--jobs is {jobs}: choose 1 to 64")
    if out is not None and (out.exists() or not out.absolute().parent.is_dir()):
        raise UsageError(f"--out {out}: give a new folder in an existing one")
    plan = ControlPlan(
        model=Path(), seeds=_seeds(seed), manoeuvres=_chosen("manoeuvre", manoeuvre, MANOEUVRES),
        cars=_chosen("car", car, CARS),
    )  # fmt: skip
    if quick:
        plan = replace(
            plan, length_m=_QUICK_M, models=tuple(name for name in MODELS if name != PLANT)
        )
    if tune and (as_json or out is not None or seed or car or jobs != 1):
        raise UsageError(
            "--tune prints a comparison on the development set: leave out --json, --out, --seed, "
            "--car and --jobs"
        )
    if not has_osqp():
        console.note(INSTALL)

    def keep(so_far: list[ScoredRun]) -> None:
        if out is not None:
            write_results(so_far, plan, out)

    try:
        with graceful_shutdown(), _model_folder(model, quick) as folder:
            plan = replace(plan, model=folder)
            if tune:
                _tune(plan)
                return
            with console.progress("driving") as bar:
                runs = run_control(plan, jobs, bar, keep)
    except Terminated:
        console.note("adk: terminated")
        raise typer.Exit(TERMINATED) from None
    if out is not None:
        _draw(runs, plan, out)
    if as_json:
        console.print_json(as_dict(runs, plan))
        return
    _print(runs)


def _seeds(given: Sequence[int] | None) -> tuple[int, ...]:
    from adk_ros.bench.control.tuning import DEVELOPMENT_SEED

    seeds = tuple(given or (1,))
    for seed in seeds:
        if seed < 0 or seed == DEVELOPMENT_SEED or seeds.count(seed) > 1:
            raise UsageError(
                f"--seed {seed}: give different seeds from 0 on, not {DEVELOPMENT_SEED} of the "
                "development set"
            )
    return seeds


def _chosen(option: str, given: Sequence[str] | None, known: Sequence[str]) -> tuple[str, ...]:
    for name in given or ():
        if name not in known:
            raise UsageError(f"--{option} '{name}' is unknown: choose one of {', '.join(known)}")
    return tuple(name for name in known if name in (given or known))


@contextmanager
def _model_folder(model: Path | None, quick: bool) -> Iterator[Path]:
    """Yield the given model folder, or that of a temporary model of the nominal car."""
    if model is not None:
        yield model
        return
    from adk_ros.bench.control.nominal_model import QUICK_STEPS, STEPS, train_nominal

    with tempfile.TemporaryDirectory(prefix="adk_control_") as folder:
        with console.progress("training on the nominal car") as bar:
            train_nominal(Path(folder) / "model", QUICK_STEPS if quick else STEPS, bar)
        yield Path(folder) / "model"


def _tune(plan: ControlPlan) -> None:
    from adk_ros.bench.control.tuning import tune

    with console.progress("comparing parameters") as bar:
        tried = tune(plan, bar)
    for item in sorted(tried, key=lambda one: (one.controller, one.mean)):
        errors = ", ".join(f"{model} {error:.3f}" for model, error in item.errors.items())
        text = f"{item.controller}, {item.text}: {item.mean:.3f} m ({errors})"
        console.output.print(text, markup=False)


def _draw(runs: Sequence[ScoredRun], plan: ControlPlan, out: Path) -> None:
    from adk_ros.bench.control.control_bench import path_of
    from adk_ros.bench.control.control_figure import write_figure

    for name in plan.manoeuvres:
        path = path_of(name, plan.length_m)
        write_figure(runs, path, out / f"{name.replace(' ', '_')}.png")


def _print(runs: Sequence[ScoredRun]) -> None:
    from rich import box
    from rich.table import Table

    from adk_ros.bench.control.scores import criteria

    groups: dict[tuple[str, ...], list[ScoredRun]] = {}
    for run in runs:
        key = (run.manoeuvre, run.car, run.controller, run.model)
        groups.setdefault(key, []).append(run)
    for manoeuvre in dict.fromkeys(key[0] for key in groups):
        table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
        table.add_column("car", no_wrap=True)
        table.add_column("controller: model", no_wrap=True)
        for name in ("error m", "max m", "v m/s", "gates", "ended", "p50", "p99 ms"):
            table.add_column(name, justify="right", no_wrap=True)
        for (name, car, controller, model), here in groups.items():
            if name == manoeuvre:
                table.add_row(car, f"{controller}: {model}", *_cells(here))
        console.output.print(
            f"{manoeuvre}: RMS and largest lateral error, RMS speed error; gates: share of their "
            "length violated;\nended: runs that got to the end; p50 and largest p99 of a cycle",
            markup=False,
        )
        console.print_table(table)
    for item in criteria(runs):
        console.output.print(f"{_VERDICTS[item.is_met]}  {item.text}", markup=False)
    console.flush()


def _cells(runs: Sequence[ScoredRun]) -> list[str]:
    """Return a row's figures: means over the seeds, with the range of the error if several."""
    scores = [run.score for run in runs]

    def mean(name: str) -> Any:
        return sum(getattr(score, name) for score in scores) / len(scores)

    errors = [score.lateral_rms for score in scores]
    error = f"{mean('lateral_rms'):.3f}"
    if len(errors) > 1:
        error += f" ({min(errors):.3f}-{max(errors):.3f})"
    return [
        error,
        f"{max(score.lateral_max for score in scores):.2f}",
        f"{mean('speed_rms'):.2f}",
        f"{mean('violations'):.1%}",
        f"{sum(score.completed for score in scores)}/{len(scores)}",
        f"{mean('p50_ms'):.1f}",
        f"{max(score.p99_ms for score in scores):.1f}",
    ]
