# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables 3 to 8, their like for our own tests and recordings, and at 0.25 to 2 s: text, CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from adk_ros.bench.paper.av21 import RecordingScores
from adk_ros.bench.paper.cases import OWN_TESTS
from adk_ros.bench.paper.paper_results import TABLES, TITLES, Entry, published
from adk_ros.bench.paper.predictors import ADK_ROS, ORDER, PAPERS
from adk_ros.bench.paper.scores import CHANNELS, HORIZONS, UNITS, ScoreTable
from adk_ros.signals.score import REPORT_SCALE

NONE = "-"


@dataclass(frozen=True)
class Table:
    """
    A table of text; `strong` are the rows to be seen first, `best` single cells (row, column).

    Of a strong row only its name is set in bold: what is not good must not look so.
    """

    name: str
    title: str
    header: list[str]
    rows: list[list[str]]
    strong: tuple[int, ...] = ()
    best: frozenset[tuple[int, int]] = frozenset()

    def bold(self, row: int, column: int) -> bool:
        """Whether a cell is set in bold."""
        return (column == 0 and row in self.strong) or (row, column) in self.best

    def markdown(self) -> str:
        """As a heading and a table."""
        lines = [f"### {self.title}", "", markdown_line(self.header)]
        lines.append(markdown_line(["---", *["---:"] * (len(self.header) - 1)]))
        for i, row in enumerate(self.rows):
            lines.append(markdown_line([
                f"**{cell}**" if self.bold(i, j) else cell for j, cell in enumerate(row)
            ]))  # fmt: skip
        return "\n".join(lines) + "\n"

    def write(self, folder: Path) -> None:
        """Write `name`.md and `name`.csv."""
        (folder / f"{self.name}.md").write_text(self.markdown())
        with (folder / f"{self.name}.csv").open("w", newline="") as file:
            csv.writer(file).writerows([self.header, *self.rows])


def markdown_line(cells: Sequence[str]) -> str:
    """Return a row of a Markdown table; a bar in a cell is escaped."""
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def number(value: float) -> str:
    """Three digits, and no more than the paper's where that says enough."""
    if value == 0.0:
        return "0"
    if value >= 99.95:
        return f"{value:.0f}"
    if value >= 9.995:
        return f"{value:.1f}"
    if value >= 0.9995:
        return f"{value:.2f}"
    return f"{value:.3g}" if value >= 1e-4 else f"{value:.1e}"


def one_step_tables(board: ScoreTable) -> list[Table]:
    """Return the paper's tables in their order, then ours; each clean, then noisy."""
    have = set(board.tests())
    result = []
    for variant in board.variants():
        for table, tests in TABLES.items():
            shown = [test for test in tests if test in have]
            if shown:
                title = f"Table {table}, {variant}: {TITLES[table]}"
                result.append(_one_step(board, variant, shown, table, title))
        for test in OWN_TESTS:
            if test in have:
                title = f"One step, {variant}: {test} (not in the paper)"
                result.append(_one_step(board, variant, [test], None, title))
    return result


def _one_step(
    board: ScoreTable, variant: str, tests: list[str], table: int | None, title: str
) -> Table:
    """Max/RMSE, with the paper's own beside them where it has any."""
    header = ["predictor"]
    for test in tests:
        of = f"{test}: " if len(tests) > 1 else ""
        for channel, unit in zip(CHANNELS, UNITS, strict=True):
            header.append(f"{of}{channel} Max/RMSE ({unit})")
            if table is not None:
                header.append("paper")
    rows = []
    names = _in_order(board, table)
    for name in names:
        row = [name]
        for test in tests:
            theirs = published(table, test).get(name) if table is not None else None
            for c in range(3):
                row.append(_max_rmse(board, variant, test, name, c))
                if table is not None:
                    row.append(_quoted(theirs, c))
        rows.append(row)
    name = f"table_{table}_{variant}" if table is not None else f"one_step_{tests[0]}_{variant}"
    return Table(name, title, header, rows, strong(names))


def _in_order(board: ScoreTable, table: int | None) -> list[str]:
    """The paper's rows for that table first; nobody stands in between."""
    names = board.names()
    if table is None:
        return names
    own = [name for name in published(table, TABLES[table][0]) if name in names]
    others = [name for name in names if name in PAPERS and name not in own]
    return own + others + [name for name in names if name not in PAPERS]


def strong(names: list[str]) -> tuple[int, ...]:
    """Return which rows are ours."""
    return tuple(i for i, name in enumerate(names) if name == ADK_ROS)


def _quoted(theirs: Entry | None, channel: int) -> str:
    if theirs is None:
        return NONE
    worst, rmse = theirs[channel]
    return f"{worst:g}/{rmse:g}"


def _diverged(board: ScoreTable, variant: str, test: str, name: str, horizon: int) -> str:
    """Say how many diverged, or nothing if none did."""
    lost, count = board.diverged(variant, test, name)
    return f"diverged ({lost[horizon]} of {count[horizon]})" if lost[horizon] else ""


def _max_rmse(board: ScoreTable, variant: str, test: str, name: str, channel: int) -> str:
    if (variant, test, name) not in board.scores:
        return NONE
    said = _diverged(board, variant, test, name, 0)
    if said:
        return said
    worst = board.worst(variant, test, name)[0, channel] * REPORT_SCALE[channel]
    rmse = board.rmse(variant, test, name)[0, channel] * REPORT_SCALE[channel]
    return f"{number(worst)}/{number(rmse)}"


def horizon_tables(board: ScoreTable) -> list[Table]:
    """Return, by test and variant, RMSE at 0.25 to 2 s under known commands."""
    result = []
    for test in board.tests():
        for variant in board.variants():
            header = ["predictor"]
            for channel, unit in zip(CHANNELS, UNITS, strict=True):
                header += [f"{channel} {horizon} ({unit})" for horizon in HORIZONS[1:]]
            names = [n for n in board.names() if (variant, test, n) in board.scores]
            rows = [[name, *_by_horizon(board, variant, test, name)] for name in names]
            title = f"{test}, {variant}: RMSE of open-loop prediction, commands known"
            result.append(Table(f"horizon_{test}_{variant}", title, header, rows, strong(names)))
    return result


def _by_horizon(board: ScoreTable, variant: str, test: str, name: str) -> list[str]:
    rmse = board.rmse(variant, test, name) * REPORT_SCALE
    return [
        _diverged(board, variant, test, name, i) or number(rmse[i, channel])
        for channel in range(3)
        for i in range(1, len(HORIZONS))
    ]


def coverage_tables(board: ScoreTable) -> list[Table]:
    """Return, by variant, the share of measurements within our 90 % intervals, in per cent."""
    result = []
    for variant in board.variants():
        header = ["test", *(f"{c} {h}" for c in CHANNELS for h in HORIZONS)]
        rows = []
        for test in [*board.tests(), None]:
            table = board.coverage(variant, test)
            cells = [f"{100.0 * v:.1f}" if v == v else NONE for v in table.T.ravel()]
            rows.append(["all tests" if test is None else test, *cells])
        title = f"Coverage of the 90 % intervals, {variant}, per cent"
        name = f"coverage_{variant}"
        result.append(Table(name, title, header, rows, (len(rows) - 1,)))
    return result


def recording_tables(recorded: RecordingScores) -> list[Table]:
    """Return, by recording trained on and tested on, RMSE at 1 step to 2 s and our ratio."""
    result = []
    for number_of, (test, by_name) in enumerate(recorded.rmse.items(), 1):
        header = ["predictor"]
        for channel, unit in zip(CHANNELS, UNITS, strict=True):
            header += [f"{channel} {horizon} ({unit})" for horizon in HORIZONS]
        names = [name for name in ORDER if name in by_name]
        rows = [
            [name, *(number(float(v)) for v in (by_name[name] * REPORT_SCALE).T.ravel())]
            for name in names
        ]
        ratio = recorded.ratios[test].T.ravel()
        rows.append([f"{ADK_ROS} / best naive", *(number(float(v)) for v in ratio)])
        trained, tested = test.split(" / ")
        where = "tested on its rest" if trained == tested else f"tested on all of {tested}"
        title = f"Trained on the first 60 % of {trained}, {where}, commands known"
        # Names of folders are other people's: they are no names for our files.
        result.append(Table(f"recording_{number_of}", title, header, rows, strong(names)))
    return result
