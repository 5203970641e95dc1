# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench: how fast the tick is, how late a live prediction comes, what a million ticks do."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption

app = typer.Typer(help="Measure speed and endurance.", no_args_is_help=True, rich_markup_mode=None)
ModelChoice = Annotated[
    Path | None, typer.Option(help="model folder; default: one trained for the purpose")
]


@app.command()
def latency(
    model: ModelChoice = None,
    ticks: Annotated[int, typer.Option(help="ticks to time")] = 100_000,
    as_json: JsonOption = False,
) -> None:
    """
    Time the whole tick, messages to prediction, beside padasip's FilterRLS for 15 outputs.

    Example: adk bench latency
    """
    from adk_ros.bench.latency import bench_latency

    with console.progress("ticking") as bar:
        result = bench_latency(model, ticks, bar)
    if as_json:
        console.answer(result)
        return
    tick, rival = result["tick"], result["padasip_rls15"]
    console.output.print(
        f"whole tick      p50 {tick['p50_us']:8.1f} us   p99 {tick['p99_us']:8.1f} us   "
        f"max {tick['max_us']:8.1f} us   over {result['ticks']} ticks"
    )
    for name, stage in result["stages"].items():
        console.output.print(
            f"  {name:<12}  p50 {stage['p50_us']:8.1f} us   p99 {stage['p99_us']:8.1f} us   "
            f"{100.0 * stage['share']:5.1f} % of the tick"
        )
    console.output.print(
        f"padasip RLS 15  p50 {rival['p50_us']:8.1f} us   p99 {rival['p99_us']:8.1f} us   "
        "(its update alone, in the same run)"
    )


@app.command()
def live(
    model: ModelChoice = None,
    duration: Annotated[float, typer.Option(help="seconds")] = 60.0,
    imu_hz: Annotated[float, typer.Option(help="IMU rate")] = 200.0,
    as_json: JsonOption = False,
) -> None:
    """
    Run the node live: latency from the last input to the prediction in another process, CPU.

    Example: adk bench live --duration 60
    """
    from adk_ros.bench.feed import write_model
    from adk_ros.bench.live import bench_live

    with tempfile.TemporaryDirectory() as folder, console.progress("running live") as bar:
        if model is None:
            model = Path(folder) / "model"
            write_model(model)
        result = bench_live(model, duration, imu_hz, progress=bar)
    if as_json:
        console.answer(result)
        return
    for name, value in result.items():
        console.output.print(f"{name:<28} {value}", markup=False)


@app.command()
def soak(
    model: ModelChoice = None,
    ticks: Annotated[int, typer.Option(help="ticks to replay")] = 1_000_000,
    as_json: JsonOption = False,
) -> None:
    """
    Replay a looped bag with faults injected: memory, finiteness, drift of the least squares.

    Example: adk bench soak --ticks 1000000
    """
    from adk_ros.bench.soak import bench_soak

    with console.progress("soaking") as bar:
        result = bench_soak(model, ticks, bar)
    if as_json:
        console.answer(result)
        return
    for name, value in result.items():
        console.output.print(f"{name:<28} {value}", markup=False)
