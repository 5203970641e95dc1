# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the verbs say: notes and progress on stderr, answers on stdout."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from adk_ros.numerics.finite import finite
from adk_ros.signals.channels import STATE_NAMES, TICK_NS
from adk_ros.signals.score import REPORT_SCALE, ErrorTable, best_naive

if TYPE_CHECKING:
    from adk_ros.bags.recording import Recording
    from adk_ros.train.held_out import HeldOutScores

errors = Console(stderr=True, highlight=False, soft_wrap=True)
output = Console(highlight=False, soft_wrap=True)
_REPORT_UNITS = ("km/h", "km/h", "deg/s")
_QUIET_S = 1.0
_LINE_EVERY_S = 10.0

_live: list[Progress] = []
"""The bar that is shown, if one is: older versions of rich refuse two at a time."""


def note(text: str) -> None:
    """Tell a person something, on stderr."""
    errors.print(text, markup=False)


def warn(text: str) -> None:
    """Tell a person of something amiss, on stderr."""
    errors.print(f"warning: {text}", style="yellow", markup=False)


def print_recording_warnings(drive: Recording, wants_imu: bool = False) -> None:
    """Tell a person what is odd about a drive; `wants_imu`: the model was trained with one."""
    for text in drive.warnings:
        warn(text)
    if wants_imu and drive.topics.imu is None:
        warn("the model was trained with an IMU and there is none: yaw rate comes from odometry")


def print_json(value: Any) -> None:
    """Print `value` as JSON on stdout; numbers that are not finite become null."""
    print(json.dumps(finite(value), indent=2))


@contextmanager
def progress(what: str) -> Iterator[Callable[..., None]]:
    """
    Yield `report(done, total, text="")`: a bar on a terminal, elsewhere a line now and then.

    Nothing is shown for what is over within a second, and one bar at a time: one that begins ends
    the one before.
    """
    started = time.monotonic()
    if errors.is_terminal:
        bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[text]}"),
            console=errors,
            transient=True,
            disable=False,
            auto_refresh=False,
        )
        task = bar.add_task(what, total=None, text="")
        shown = False
        refreshed = 0.0

        def report(done: float, total: float, text: str = "") -> None:
            nonlocal shown, refreshed
            now = time.monotonic()
            if not shown and now - started > _QUIET_S:
                while _live:
                    _live.pop().stop()
                bar.start()
                _live.append(bar)
                shown = True
            if bar in _live and (now - refreshed > 0.1 or done == total):
                bar.update(task, completed=done, total=total, text=text)
                bar.refresh()
                refreshed = now

        try:
            yield report
        finally:
            if bar in _live:
                _live.remove(bar)
                bar.stop()
        return
    last = started

    def line(done: float, total: float, text: str = "") -> None:
        nonlocal last
        now = time.monotonic()
        if now - last > _LINE_EVERY_S and total:
            note(f"{what}: {100.0 * done / total:.0f} %{'  ' + text if text else ''}")
            last = now

    yield line


def score_table(scores: dict[str, ErrorTable], model_names: tuple[str, ...], title: str) -> Table:
    """RMSE by channel and horizon, km/h and deg/s; `model_names`: commands known and held."""
    naive = [name for name in scores if name not in model_names]
    best = best_naive({name: scores[name] for name in naive})
    # Narrow enough for 80 columns: headings are broken, units stand below the channels.
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=0)
    table.add_column("channel")
    table.add_column("horizon")
    for name in (*model_names, *naive):
        table.add_column(name.replace(" ", "\n"), justify="right")
    # The node publishes what comes of held commands; known ones show what the model can do.
    table.add_column("known\n/best", justify="right")
    table.add_column("held\n/best", justify="right")
    first = scores[model_names[0]]
    for channel, (label, unit) in enumerate(zip(STATE_NAMES, _REPORT_UNITS, strict=True)):
        for row, step in enumerate(first.steps):
            cells = [
                f"{scores[name].rmse[row, channel] * REPORT_SCALE[channel]:.4g}"
                for name in (*model_names, *naive)
            ]
            ratios = [
                scores[name].rmse[row, channel] / max(best[row, channel], 1e-12)
                for name in model_names
            ]
            name = label if row == 0 else unit if row == 1 else ""
            table.add_row(
                name,
                f"{step * TICK_NS * 1e-9:g} s",
                *cells,
                *(f"{r:.2f}" for r in ratios),
                end_section=row == len(first.steps) - 1,
                style=None if ratios[0] < 1.0 else "yellow",
            )
    return table


def print_table(table: Table) -> None:
    """Print a table on stdout, as wide as it needs to be where nobody looks."""
    console = output if output.is_terminal else Console(highlight=False, width=120)
    console.print(table)


def flush() -> None:
    """Hand on what was printed, so that notes on stderr come after it."""
    sys.stdout.flush()


def show_test(test: HeldOutScores, title: str) -> None:
    """Print a held-out table, and of each cell that a naive predictor wins the reason."""
    from adk_ros.train.held_out import HELD_INPUTS, MODEL

    starts = test.scores[MODEL].count
    print_table(score_table(test.scores, (MODEL, HELD_INPUTS), f"{title} ({starts} starts)"))
    flush()
    for cell, why in test.lost.items():
        note(f"not better than a naive predictor, commands known: {cell}: {why}")
