# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench fleet: throughput, scaling and engines of adk fleet."""

from __future__ import annotations

from enum import Enum
from typing import Annotated, Any

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption


class Part(str, Enum):
    """Parts of the benchmark."""

    THROUGHPUT = "throughput"
    SCALING = "scaling"
    ENGINES = "engines"


def fleet(
    part: Annotated[
        Part,
        typer.Option(
            help="throughput: against a loop and joblib; scaling: cost per recording and memory "
            "as the fleet grows; engines: Dask and Ray"
        ),
    ] = Part.THROUGHPUT,
    recordings: Annotated[
        int, typer.Option(help="recordings (throughput, engines), at least 20")
    ] = 200,
    seconds: Annotated[
        float, typer.Option(help="processor time of the work on one recording, s")
    ] = 0.1,
    wait: Annotated[
        float, typer.Option(help="time that the work on one recording waits without computing, s")
    ] = 0.0,
    rounds: Annotated[int, typer.Option(help="rounds, of which the shortest counts")] = 3,
    sizes: Annotated[
        list[int] | None,
        typer.Option(help="sizes of the fleet (scaling, repeatable)", show_default="20 to 1000"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """
    Measure adk fleet: overhead against a plain loop, scaling, and the engines it could use.

    Example: adk bench fleet --part scaling --sizes 20 --sizes 1000
    """
    from adk_ros.bench.fleet.engines import bench_engines
    from adk_ros.bench.fleet.throughput import bench_scaling, bench_throughput
    from adk_ros.bench.fleet.work import BusyStage

    stage = BusyStage(seconds, wait)
    result: Any
    with console.progress(part.value) as bar:
        if part is Part.THROUGHPUT:
            result = bench_throughput(recordings, stage, rounds, bar)
        elif part is Part.SCALING:
            result = bench_scaling(sizes or [20, 100, 300, 1000], stage, bar)
        else:
            result = bench_engines(recordings, stage, rounds, bar)
    if as_json:
        console.print_json(result)
    elif part is Part.THROUGHPUT:
        _print_throughput(result)
    elif part is Part.SCALING:
        _print_scaling(result)
    else:
        _print_engines(result)


def _print_throughput(result: dict[str, Any]) -> None:
    console.output.print(f"{result['recordings']} recordings of {result['work']}:")
    for name, times in result["rows"].items():
        console.output.print(
            f"  {name:<22}{times['work_s']:8.2f} s   with start {times['total_s']:8.2f} s"
        )
    console.output.print(
        f"  overhead of one worker over a loop {100.0 * result['overhead']:.1f} %, two workers "
        f"{result['speedup']:.2f} times one (joblib {result['speedup_joblib']:.2f} times a loop)"
    )


def _print_scaling(rows: list[dict[str, Any]]) -> None:
    for row in rows:
        console.output.print(
            f"{row['recordings']:>7} recordings: {row['work_s']:7.1f} s, {row['cost_ms']:6.1f} ms "
            f"of a worker each, driver {row['driver_mib']:.0f} MiB, worker "
            f"{row['worker_mib']:.0f} MiB, listing {row['listing_s']:.2f} s, resuming "
            f"{row['resume_s']:.2f} s, {row['files']} files"
        )


def _print_engines(result: dict[str, Any]) -> None:
    console.output.print(
        f"{result['recordings']} stages of {result['work']}, in a loop "
        f"{result['loop_s']:.1f} s; with two workers:"
    )
    for name in ("dask", "ray"):
        engine = result[name]
        if engine is None:
            console.output.print(f"  {name:<5} not installed")
            continue
        console.output.print(
            f"  {name:<5} start {engine['start_s']:5.1f} s, run {engine['run_s']:6.2f} s "
            f"({engine['speedup']:.2f} times the loop), with a killed worker "
            f"{engine['killed_run_s']:6.2f} s, {engine['processes']} processes, "
            f"{engine['memory_mib']:.0f} MiB"
        )
