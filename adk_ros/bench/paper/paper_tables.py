# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables 3 to 8 of the paper, and tables of additional tests, horizons and recordings."""

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
    A table of text; `strong` are highlighted rows, `best` highlighted cells (row, column).

    Of a highlighted row only the name is bold, so that a poor value is not emphasised.
    """

    name: str
    title: str
    header: list[str]
    rows: list[list[str]]
    strong: tuple[int, ...] = ()
    best: frozenset[tuple[int, int]] = frozenset()

    def bold(self, row: int, column: int) -> bool:
        """Return whether a cell is bold."""
        return (column == 0 and row in self.strong) or (row, column) in self.best

    def markdown(self) -> str:
        """Return a heading and a table in Markdown."""
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
    """Format a value with three significant digits, at most two decimals from 1 on."""
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
    """Return the tables of the paper, then those of additional tests; clean, then noisy."""
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
    """Return Max/RMSE by predictor, with the values of the paper where it has any."""
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
            quoted = published(table, test).get(name) if table is not None else None
            for c in range(3):
                row.append(_max_rmse(board, variant, test, name, c))
                if table is not None:
                    row.append(_quoted(quoted, c))
        rows.append(row)
    name = f"table_{table}_{variant}" if table is not None else f"one_step_{tests[0]}_{variant}"
    return Table(name, title, header, rows, strong(names))


def _in_order(board: ScoreTable, table: int | None) -> list[str]:
    """Return the predictors with the rows of that table of the paper first."""
    names = board.names()
    if table is None:
        return names
    printed = [name for name in published(table, TABLES[table][0]) if name in names]
    others = [name for name in names if name in PAPERS and name not in printed]
    return printed + others + [name for name in names if name not in PAPERS]


def strong(names: list[str]) -> tuple[int, ...]:
    """Return the rows of adk_ros."""
    return tuple(i for i, name in enumerate(names) if name == ADK_ROS)


def _quoted(quoted: Entry | None, channel: int) -> str:
    if quoted is None:
        return NONE
    worst, rmse = quoted[channel]
    return f"{worst:g}/{rmse:g}"


def _diverged(board: ScoreTable, variant: str, test: str, name: str, horizon: int) -> str:
    """Return how many predictions diverged, or "" if none did."""
    lost, count = board.diverged(variant, test, name)
    return f"diverged ({lost[horizon]} of {count[horizon]})" if lost[horizon] else ""


def _max_rmse(board: ScoreTable, variant: str, test: str, name: str, channel: int) -> str:
    if (variant, test, name) not in board.scores:
        return NONE
    diverged = _diverged(board, variant, test, name, 0)
    if diverged:
        return diverged
    worst = board.worst(variant, test, name)[0, channel] * REPORT_SCALE[channel]
    rmse = board.rmse(variant, test, name)[0, channel] * REPORT_SCALE[channel]
    return f"{number(worst)}/{number(rmse)}"


def horizon_tables(board: ScoreTable) -> list[Table]:
    """Return one table per test and variant: RMSE at 0.25 to 2 s, future commands known."""
    result = []
    for test in board.tests():
        for variant in board.variants():
            header = ["predictor"]
            for channel, unit in zip(CHANNELS, UNITS, strict=True):
                header += [f"{channel} {horizon} ({unit})" for horizon in HORIZONS[1:]]
            names = [n for n in board.names() if (variant, test, n) in board.scores]
            rows = [[name, *_by_horizon(board, variant, test, name)] for name in names]
            title = f"{test}, {variant}: RMSE of open-loop prediction, future commands known"
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
    """Return one table per variant: measurements within the 90 % intervals, in percent."""
    result = []
    for variant in board.variants():
        header = ["test", *(f"{c} {h}" for c in CHANNELS for h in HORIZONS)]
        rows = []
        for test in [*board.tests(), None]:
            table = board.coverage(variant, test)
            cells = [f"{100.0 * v:.1f}" if v == v else NONE for v in table.T.ravel()]
            rows.append(["all tests" if test is None else test, *cells])
        title = f"Coverage of the 90 % intervals, {variant}, percent"
        name = f"coverage_{variant}"
        result.append(Table(name, title, header, rows, (len(rows) - 1,)))
    return result


def recording_tables(recorded: RecordingScores) -> list[Table]:
    """Return one table per pair of training and test recording: RMSE and ratio by horizon."""
    result = []
    for count, (test, by_name) in enumerate(recorded.rmse.items(), 1):
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
        where = (
            "tested on the remaining 40 %" if trained == tested else f"tested on all of {tested}"
        )
        title = f"Trained on the first 60 % of {trained}, {where}, future commands known"
        # The folder names of recordings are not used as file names: they may contain anything.
        result.append(Table(f"recording_{count}", title, header, rows, strong(names)))
    return result
