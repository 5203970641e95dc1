# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench: measure tick time, latency, endurance and accuracy."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from adk_ros.cli import (
    bench_confirm,
    bench_control,
    bench_fleet,
    bench_learned,
    bench_mismatch,
    bench_paper,
    bench_range,
    bench_real,
    bench_watch,
    console,
)
from adk_ros.cli.options import JsonOption

app = typer.Typer(
    help="Measure speed, endurance and accuracy.", no_args_is_help=True, rich_markup_mode=None
)
app.command("paper")(bench_paper.paper)
app.command("concealed")(bench_mismatch.concealed)
app.command("control")(bench_control.control)
app.command("watch")(bench_watch.watch)
app.command("confirm")(bench_confirm.confirm)
app.command("range")(bench_range.bench_range)
app.command("real")(bench_real.real)
app.command("learned")(bench_learned.learned)
app.command("fleet")(bench_fleet.fleet)
ModelChoice = Annotated[
    Path | None, typer.Option(help="model folder", show_default="train a temporary one, 40 s")
]


@app.command()
def latency(
    model: ModelChoice = None,
    ticks: Annotated[int, typer.Option(help="ticks to time")] = 100_000,
    as_json: JsonOption = False,
) -> None:
    """
    Time one tick, back to back and after pauses, compared with padasip's RLS for 15 outputs.

    Also 1000 rollouts at once, as for a planner, compared with a loop over single rollouts. Prints
    PASS or FAIL for these.

    Example: adk bench latency
    """
    from adk_ros.bench.runtime.latency import bench_latency, check_latency

    check_latency(ticks)
    with _model_to_measure(model) as path, console.progress("timing ticks") as bar:
        result = bench_latency(path, ticks, bar)
    if as_json:
        console.print_json(result)
        return
    _print_comparison("back to back", result)
    _print_comparison(
        f"after pauses of {result['after_pause']['pause_ms']:g} ms", result["after_pause"]
    )
    _print_rollouts(result["rollouts"])
    console.output.print("stages, back to back:")
    for name, stage in result["stages"].items():
        console.output.print(
            f"  {name:<12}  p50 {stage['p50_us']:8.1f} us   p99 {stage['p99_us']:8.1f} us   "
            f"{100.0 * stage['share']:5.1f} % of the tick"
        )


def _print_rollouts(times: dict[str, Any]) -> None:
    from adk_ros.bench.runtime.rollout_latency import MAX_MS

    console.output.print(f"{times['candidates']} rollouts of {times['steps']} steps:")
    for title, of in (("back to back", times), ("after pauses", times["after_pause"])):
        console.output.print(
            f"  {title:<14}at once p50 {of['many']['p50_ms']:6.2f} ms   "
            f"in a loop p50 {of['loop']['p50_ms']:6.2f} ms   loop / at once {of['ratio']:5.2f}   "
            f"gradient of one p50 {of['gradient']['p50_ms']:5.2f} ms"
        )
    verdict = "PASS" if times["is_fast"] else "FAIL"
    console.output.print(f"  {verdict}  at once, back to back: at most {MAX_MS:g} ms")


def _print_comparison(title: str, times: dict[str, Any]) -> None:
    tick, baseline = times["tick"], times["padasip_rls15"]
    console.output.print(
        f"{title}, {times['ticks']} ticks:\n"
        f"  whole tick    p50 {tick['p50_us']:8.1f} us   p99 {tick['p99_us']:8.1f} us   "
        f"max {tick['max_us']:8.1f} us\n"
        f"  padasip RLS   p50 {baseline['p50_us']:8.1f} us   p99 {baseline['p99_us']:8.1f} us   "
        f"(15 outputs, update only)\n"
        f"  tick / padasip    {times['ratio']:8.2f}"
    )


@app.command()
def live(
    model: ModelChoice = None,
    duration: Annotated[float, typer.Option(help="seconds to measure, 1 to 86400")] = 60.0,
    imu_hz: Annotated[float, typer.Option(help="IMU rate, Hz")] = 200.0,
    as_json: JsonOption = False,
) -> None:
    """
    Measure the live node: latency, tick time, missed ticks, CPU load compared with a relay.

    The relay only receives and republishes the same messages. A listener subscribes to the twist
    and the horizon. Prints PASS or FAIL for each target.

    Example: adk bench live --duration 60
    """
    from adk_ros.bench.runtime.live import bench_live, check_live

    check_live(duration, imu_hz)
    with _model_to_measure(model) as path, console.progress("running live") as bar:
        result = bench_live(path, duration, imu_hz, progress=bar)
    _show(result, as_json)


@app.command()
def rollouts(
    model: ModelChoice = None,
    requests: Annotated[int, typer.Option(help="requests of each size, 5 to 10000")] = 100,
    as_json: JsonOption = False,
) -> None:
    """
    Time rollouts of candidate commands through the topics of a live node, and in-process.

    Example: adk bench rollouts --model model
    """
    from adk_ros.bench.runtime.rollout_transport import bench_rollout_transport, check_requests

    check_requests(requests)
    with _model_to_measure(model) as path, console.progress("asking for rollouts") as bar:
        result = bench_rollout_transport(path, requests, bar)
    if as_json:
        console.print_json(result)
        return
    for row in result["rows"]:
        by_topic, local = row["by_topic"], row["in_process"]
        console.output.print(
            f"{row['candidates']:>5} x {result['steps']} steps, {1e-6 * row['bytes']:5.2f} MB: "
            f"by topic p50 {by_topic['p50_ms']:6.2f} ms, p99 {by_topic['p99_ms']:6.2f} ms   "
            f"in-process p50 {local['p50_ms']:6.2f} ms, p99 {local['p99_ms']:6.2f} ms"
        )


@app.command()
def soak(
    model: ModelChoice = None,
    ticks: Annotated[int, typer.Option(help="ticks to replay")] = 1_000_000,
    as_json: JsonOption = False,
) -> None:
    """
    Replay a looped drive with injected faults: memory growth, NaN, numerical drift.

    A million ticks are 7 h of driving. Prints PASS or FAIL for each of these, and for failed
    adaptations.

    Example: adk bench soak --ticks 10000000
    """
    from adk_ros.bench.runtime.soak import bench_soak, check_soak

    check_soak(ticks)
    with _model_to_measure(model) as path, console.progress("replaying with faults") as bar:
        result = bench_soak(path, ticks, bar)
    _show(result, as_json)


@app.command()
def plan(
    model: ModelChoice = None,
    duration: Annotated[float, typer.Option(help="seconds of a drive, 30 to 3600")] = 180.0,
    seed: Annotated[
        list[int] | None,
        typer.Option(help="seed of a simulated drive (repeatable)", show_default="1, 2, 3"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """
    Horizons and their 90 % intervals on simulated drives: commands held, and planned.

    Prints PASS or FAIL for each kind of plan: the intervals cover 85 to 95 % of the measurements,
    and their width and interval score are below those of the best naive predictor.

    Example: adk bench plan --model model
    """
    from adk_ros.bench.runtime.plan_bench import KINDS, SEEDS, bench_plans, check_duration

    check_duration(duration)
    with _model_to_measure(model) as path, console.progress("driving with plans") as bar:
        result = bench_plans(path, duration, seed or SEEDS, bar)
    if as_json:
        console.print_json(result)
        return
    console.output.print(
        f"{result['starts']} starts; by horizon: RMSE / best naive, coverage (path: RMSE)"
    )
    for kind in KINDS:
        console.output.print(f"{kind} (followed {100.0 * result[kind]['followed']:.0f} %)")
        for c, state in enumerate(result["states"]):
            cells = [
                f"{horizon:g} s {ratio[c]:.3f} {100.0 * coverage[c]:.0f} %"
                for horizon, ratio, coverage in zip(
                    result["horizons_s"], result[kind]["ratio"], result[kind]["coverage"],
                    strict=True,
                )
            ]  # fmt: skip
            console.output.print(f"  {state:<9}" + "   ".join(cells))
        for c, (name, unit) in enumerate((("x", "m"), ("y", "m"), ("heading", "rad"))):
            cells = [
                f"{horizon:g} s {rmse[c]:.3g} {unit} {100.0 * coverage[c]:.0f} %"
                for horizon, rmse, coverage in zip(
                    result["horizons_s"], result[kind]["path_rmse"],
                    result[kind]["path_coverage"], strict=True,
                )
            ]  # fmt: skip
            console.output.print(f"  {name:<9}" + "   ".join(cells))
    _print_criteria(result)


@contextmanager
def _model_to_measure(model: Path | None) -> Iterator[Path]:
    """Yield the given model folder, or that of a temporary model, which is removed at the end."""
    if model is not None:
        yield model
        return
    from adk_ros.bench.runtime.synthetic_feed import write_model

    with tempfile.TemporaryDirectory() as folder:
        with console.progress("training a temporary model") as bar:
            write_model(Path(folder) / "model", bar)
        yield Path(folder) / "model"


def _show(result: dict[str, Any], as_json: bool) -> None:
    if as_json:
        console.print_json(result)
        return
    for name, value in result.items():
        if name == "criteria":
            continue
        inner = value.items() if isinstance(value, dict) else ()
        text = ", ".join(f"{key} {item}" for key, item in inner) if inner else value
        console.output.print(f"{name:<20} {text}", markup=False)
    _print_criteria(result)


def _print_criteria(result: dict[str, Any]) -> None:
    for item in result.get("criteria", ()):
        console.output.print(f"{item['verdict']} {item['name']} {item['figure']}", markup=False)
