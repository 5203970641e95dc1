# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Terminal output of the verbs: notes and progress on stderr, results on stdout."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from adk_ros.numerics.finite import finite, number_or_dash
from adk_ros.shutdown import raise_received
from adk_ros.signals.channels import STATE_NAMES, TICK_NS
from adk_ros.signals.score import DISPLAY_NAMES, REPORT_SCALE, ErrorTable, best_naive

if TYPE_CHECKING:
    from adk_ros.train.held_out import HeldOutScores

errors = Console(stderr=True, highlight=False, soft_wrap=True)
output = Console(highlight=False, soft_wrap=True)
REPORT_UNITS = ("km/h", "km/h", "deg/s")
_HEADINGS = {
    "model": "model, commands known",
    "straight line": "linear extrap.",
}
"""Headings of columns that are not named as in files or too wide for a table of 80 columns."""

_MIN_SHOWN_S = 1.0
"""Work that takes less time shows no progress."""

_LINE_INTERVAL_S = 10.0
"""Time between two progress lines if stderr is not a terminal."""

_REFRESH_INTERVAL_S = 0.1
"""Time between two updates of a progress bar."""

_live: list[Progress] = []
"""The progress bar on the screen, if any: older versions of rich refuse a second one."""


def note(text: str) -> None:
    """Print a line on stderr."""
    errors.print(text, markup=False)


def warn(text: str) -> None:
    """Print a warning on stderr."""
    errors.print(f"warning: {text}", style="yellow", markup=False)


def note_all(texts: Iterable[str]) -> None:
    """Print each text that is not empty as a line on stderr."""
    for text in texts:
        if text:
            note(text)


def warn_all(texts: Iterable[str]) -> None:
    """Print a warning for each text."""
    for text in texts:
        warn(text)


def print_json(value: Any) -> None:
    """Print `value` as JSON on stdout; numbers that are not finite become null."""
    print(json.dumps(finite(value), indent=2))


@contextmanager
def progress(what: str) -> Iterator[Callable[..., None]]:
    """
    Yield `report(done, total, text="")`: a bar on a terminal, otherwise a line every 10 s.

    Work of less than a second shows nothing. Only one bar is visible: a new one replaces it.
    A report raises the exception of a signal again that other code caught.
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
            raise_received()
            now = time.monotonic()
            if not shown and now - started > _MIN_SHOWN_S:
                while _live:
                    _live.pop().stop()
                bar.start()
                _live.append(bar)
                shown = True
            if bar in _live and (now - refreshed > _REFRESH_INTERVAL_S or done == total):
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
        raise_received()
        now = time.monotonic()
        if now - last > _LINE_INTERVAL_S and total:
            note(f"{what}: {100.0 * done / total:.0f} %{'  ' + text if text else ''}")
            last = now

    yield line


@contextmanager
def stages() -> Iterator[Callable[[str, float, float, str], None]]:
    """Yield a progress callback for the Python interface: `progress` for one stage at a time."""
    with ExitStack() as shown:
        current = ""
        report: Callable[..., None] = lambda *_: None  # noqa: E731

        def on_progress(stage: str, done: float, total: float, detail: str) -> None:
            nonlocal current, report
            if stage != current:
                shown.close()
                report = shown.enter_context(progress(stage))
                current = stage
            report(done, total, detail)

        yield on_progress


def score_table(scores: dict[str, ErrorTable], model_names: tuple[str, ...], title: str) -> Table:
    """
    Return RMSE by channel and horizon in km/h and deg/s as a table of at most 80 columns.

    :param model_names: the model's scores with future commands known and with commands held
        constant; all others are naive predictors.
    """
    naive = [name for name in scores if name not in model_names]
    best = best_naive({name: scores[name] for name in naive})
    # Headings are broken into lines and units stand below the channels to fit 80 columns.
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=0)
    table.add_column("channel")
    table.add_column("horizon")
    for name in (*model_names, *naive):
        heading = _HEADINGS.get(name) or DISPLAY_NAMES.get(name, name)
        table.add_column(heading.replace(" ", "\n"), justify="right")
    table.add_column("known\n/best\nnaive", justify="right")
    table.add_column("held\n/best\nnaive", justify="right")
    first = scores[model_names[0]]
    for channel, (label, unit) in enumerate(zip(STATE_NAMES, REPORT_UNITS, strict=True)):
        for row, step in enumerate(first.steps):
            errors_shown = [
                number_or_dash(scores[name].rmse[row, channel] * REPORT_SCALE[channel], ".4g")
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
                *errors_shown,
                *(number_or_dash(ratio, ".2f") for ratio in ratios),
                end_section=row == len(first.steps) - 1,
                style=None if ratios[0] < 1.0 else "yellow",
            )
    return table


def print_table(table: Table) -> None:
    """Print a table on stdout, at its natural width if stdout is not a terminal."""
    console = output if output.is_terminal else Console(highlight=False, width=120)
    console.print(table)


def flush() -> None:
    """Flush stdout, so that later notes on stderr appear after it."""
    sys.stdout.flush()


def print_scores(scores: HeldOutScores, title: str) -> None:
    """Print the score table, how to read it, and why the model is not better where it is not."""
    from adk_ros.train.held_out import HELD_INPUTS, MODEL

    starts = scores.scores[MODEL].count
    print_table(score_table(scores.scores, (MODEL, HELD_INPUTS), f"{title} ({starts} rollouts)"))
    output.print(
        "known: future commands known; held: commands held constant, as the live node does.\n"
        "Naive predictors: persistence, linear extrapolation, IMU integration. Ratios below 1\n"
        "are better than every naive predictor.",
        markup=False,
    )
    flush()
    for combination, reason in scores.lost.items():
        note(f"not better than a naive predictor, future commands known: {combination}: {reason}")


def print_scope(rows: list[dict[str, str]]) -> None:
    """Print what a recording allows, why not more, and what would allow it."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    style = {"yes": "green", "reduced": "yellow", "no": "red"}
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    table.add_column("what", no_wrap=True)
    table.add_column("possible", no_wrap=True)
    table.add_column("why not")
    table.add_column("what would allow it")
    for row in rows:
        cells = (row["name"], row["possible"], row["why"], row["needs"])
        table.add_row(*(Text(x, style[x] if x == row["possible"] else "") for x in cells))
    print_table(table)
