# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `adk fleet replay` prints of a model: errors, also by tag, and surprising minutes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich import box
from rich.table import Table
from rich.text import Text

from adk_ros.cli import console
from adk_ros.signals.channels import STATE_NAMES
from adk_ros.signals.score import REPORT_SCALE

if TYPE_CHECKING:
    from adk_ros.api.fleet.replay_summary import PooledError, ReplaySummary


_MOST_VALUES = 10
"""Values of a tag that are printed: of a number there may be as many as recordings. By choice."""


def print_replay(summary: ReplaySummary) -> None:
    """Print the RMSE by condition, tag, channel and horizon, and the most surprising minutes."""
    if summary.errors:
        recordings = max(each.recordings for each in summary.errors)
        title = f"RMSE with future commands known ({recordings} recordings)"
        by_condition: dict[str, list[PooledError]] = {}
        for each in summary.errors:
            by_condition.setdefault(each.condition or "all", []).append(each)
        console.print_table(_table(title, by_condition))
    by_value = {
        f"{tag} = {value}": found
        for tag, by in summary.errors_by_tag.items()
        if len(by) <= _MOST_VALUES
        for value, found in by.items()
    }
    if by_value:
        title = "RMSE by column of fleet.csv"
        console.print_table(_table(title, by_value, with_recordings=True))
    for tag, by in summary.errors_by_tag.items():
        if len(by) > _MOST_VALUES:
            console.note(f"{tag} has {len(by)} values: give it as classes, or see --json")
    for minute in summary.surprises:
        console.output.print(
            f"surprise: {minute.recording} from {minute.from_s:.0f} s: {minute.value:.2f} "
            f"standard deviations, most in {minute.channel}",
            markup=False,
        )


def _table(
    title: str, groups: Mapping[str, Sequence[PooledError]], with_recordings: bool = False
) -> Table:
    """Return the errors as a table: a row for each group and channel."""
    horizons = sorted({each.horizon_s for found in groups.values() for each in found})
    table = Table(
        title=title,
        title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False,
    )  # fmt: skip
    table.add_column("condition")
    for name in (*["recordings"] * with_recordings, "rollouts", "channel"):
        table.add_column(name, no_wrap=True)
    for horizon in horizons:
        table.add_column(f"{horizon:g} s", justify="right")
    for label, errors in groups.items():
        values = {(each.channel, each.horizon_s): each for each in errors}
        recordings = str(max(each.recordings for each in errors))
        for index, channel in enumerate(STATE_NAMES):
            found = [values.get((channel, horizon)) for horizon in horizons]
            counts = [each.count for each in found if each is not None]
            first = [recordings] * with_recordings + [str(max(counts, default=""))]
            table.add_row(
                # A value of the user may look like markup.
                Text(label if index == 0 else ""),
                *(first if index == 0 else [""] * len(first)),
                f"{channel}, {console.REPORT_UNITS[index]}",
                *("-" if e is None else f"{e.value * REPORT_SCALE[index]:.4g}" for e in found),
                end_section=index == len(STATE_NAMES) - 1,
            )
    return table
