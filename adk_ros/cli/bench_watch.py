# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench watch: how soon and how rightly `adk watch` names changes, and how often it errs."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.errors import UsageError

_MAX_HOURS, _MAX_ROUNDS = 1000.0, 100


def watch(
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate", help="calibrate the threshold on clean drives that no proof contains"
        ),
    ] = False,
    hours: Annotated[
        float, typer.Option(help="hours of clean driving, simulated; 0: none")
    ] = 20.0,
    rounds: Annotated[int, typer.Option(help="drives of each event and strength; 0: none")] = 3,
    strength: Annotated[
        list[float] | None,
        typer.Option(
            help="size of the events, as a fraction of the full one (repeatable)",
            show_default="1 and 0.5",
        ),
    ] = None,
    live: Annotated[
        float,
        typer.Option(
            help="seconds in which the CPU load of the whole node is measured, in real time and "
            "after 150 s of learning; 0: none"
        ),
    ] = 0.0,
    out: Annotated[
        Path | None, typer.Option(help="file for the results, one JSON object a line")
    ] = None,
) -> None:
    """
    Watch simulated drives: events that must be named, and clean hours without alarm.

    An hour of clean driving takes about 3 min of an AMD EPYC core, an event 20 s.

    Example: adk bench watch --hours 2 --rounds 1
    """
    from adk_ros.bench.mismatch import watch_bench as bench
    from adk_ros.bench.mismatch.watch_load import check_live, load_line, watch_load
    from adk_ros.mismatch.watch.settings import ALARM_THRESHOLD

    strengths = strength or [1.0, 0.5]
    if not 0.0 <= hours <= _MAX_HOURS:
        raise UsageError(f"--hours is {hours:g}: choose 0 to {_MAX_HOURS:g}")
    if not 0 <= rounds <= _MAX_ROUNDS:
        raise UsageError(f"--rounds is {rounds}: choose 0 to {_MAX_ROUNDS}")
    if not all(0.05 <= x <= 2.0 for x in strengths):
        raise UsageError("--strength is a fraction of the full size: choose 0.05 to 2")
    if out is not None and not out.absolute().parent.is_dir():
        raise UsageError(f"--out {out}: the folder does not exist")
    check_live(live)
    first = bench.CALIBRATION if calibrate else bench.CLEAN
    threshold = float("inf") if calibrate else ALARM_THRESHOLD
    cleans = bench.clean_drives(first, hours) if hours > 0.0 else []
    events = [] if calibrate or not rounds else bench.event_drives(strengths, rounds)
    with console.progress("clean drives") as bar:
        clean = bench.run_all(
            [partial(bench.run_clean, drive, threshold) for drive in cleans],
            bar,
            lambda x: console.output.print(
                f"{x.plant} {x.road_style}: {x.hours:.2f} h, maxima {x.maxima}, "
                f"{', '.join(x.alarms) or 'no alarm'}",
                markup=False,
            ),
        )
    with console.progress("events") as bar:
        named = bench.run_all(
            [partial(bench.run_event, event, drive) for event, drive in events],
            bar,
            lambda x: console.output.print(bench.event_line(x), markup=False),
        )
    if out is not None:
        bench.write_results(out, [*clean, *named])
    lines = bench.calibration_lines(clean) if calibrate else []
    lines += bench.clean_lines(clean) if clean and not calibrate else []
    lines += bench.event_lines(named) if named else []
    if live:
        with console.progress("a drive in real time") as bar:
            lines.append(load_line(watch_load(live, bar)))
    for line in lines:
        console.output.print(line, markup=False)
