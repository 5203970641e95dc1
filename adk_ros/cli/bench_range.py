# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench range: predictions beyond the range that a model was trained on."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.bench.runtime.range_bench import RangeCase

_FIGURES = (".png", ".svg", ".pdf")


def bench_range(
    model: Annotated[Path, typer.Option(help="model folder")],
    speed: Annotated[
        list[float] | None,
        typer.Option(
            help="top speed of a slalom, km/h (repeatable)",
            show_default="100, 110, 123, 130, 137, 145, 160",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="seed of the drives and of their noise")] = 31,
    figure: Annotated[
        Path | None, typer.Option(help="PNG, SVG or PDF file for the ratio against speed")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """
    Score a model beyond its training: slaloms at 100 to 160 km/h, friction 0.3 to 1, +40 % load.

    Where the car would spin, a slalom is steered less. Also stop and go, and reversing. Prints
    PASS or FAIL: no ratio to the best naive predictor above 1.02, at any horizon of 25 ms to 2 s.
    Takes 10 s a slalom.

    Example: adk bench range --model model --figure range.png
    """
    from adk_ros.bench.runtime import range_bench

    if figure is not None and figure.suffix not in _FIGURES:
        raise UsageError(f"--figure {figure}: the name must end with {', '.join(_FIGURES)}")
    if figure is not None and not figure.absolute().parent.is_dir():
        raise UsageError(f"--figure {figure}: the folder does not exist")
    with console.progress("driving beyond the training range") as bar:
        cases = range_bench.bench_range(model, speed or range_bench.SPEEDS_KMH, seed, bar)
    if figure is not None:
        from adk_ros.bench.runtime.range_figure import write_range_figure

        write_range_figure(cases, figure)
    if as_json:
        console.print_json({"cases": [case.as_dict() for case in cases]})
        return
    _print(cases)


def _print(cases: list[RangeCase]) -> None:
    from rich import box
    from rich.table import Table

    from adk_ros.bench.runtime.range_bench import MAX_RATIO

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    table.add_column("drive", no_wrap=True)
    for heading in (
        "km/h", "steering rad", "sideslip °", "a_y m/s²", "starts beyond training",
        "v_x", "v_y", "yaw rate", "v_x", "v_y", "yaw rate", f"above {MAX_RATIO:g}",
    ):  # fmt: skip
        table.add_column(heading, justify="right")
    for case in cases:
        ratios = [*case.known.max(axis=0), *case.held.max(axis=0)]
        table.add_row(
            case.variant,
            f"{case.speed_kmh:g}",
            f"{case.peak.steering:.4f}",
            f"{math.degrees(case.peak.sideslip):.1f}",
            f"{case.peak.lateral_accel:.1f}",
            f"{case.beyond:.0%}",
            *(f"{ratio:.2f}" for ratio in ratios),
            str(case.above),
        )
    console.output.print(
        "Largest steering, sideslip and lateral acceleration: a slalom is steered less where the "
        "car would spin.\nLargest RMSE / best naive predictor's over the horizons; commands "
        "known, then held:"
    )
    console.print_table(table)
    above = sum(case.above for case in cases)
    verdict = "FAIL" if above else "PASS"
    console.output.print(f"{verdict}  {above} of {30 * len(cases)} ratios above {MAX_RATIO:g}")
    console.flush()
