# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `adk fleet replay` prints of a model: errors and surprising minutes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich import box
from rich.table import Table

from adk_ros.cli import console
from adk_ros.signals.channels import STATE_NAMES
from adk_ros.signals.score import REPORT_SCALE

if TYPE_CHECKING:
    from adk_ros.api.fleet.replay_summary import ReplaySummary


def print_replay(summary: ReplaySummary) -> None:
    """Print the RMSE by condition, channel and horizon, and the most surprising minutes."""
    if summary.errors:
        console.print_table(_table(summary))
    for each in summary.surprises:
        console.output.print(
            f"surprise: {each.recording} from {each.from_s:.0f} s: {each.value:.2f} standard "
            f"deviations, most in {each.channel}",
            markup=False,
        )


def _table(summary: ReplaySummary) -> Table:
    """Return the errors as a table: a row for each condition and channel."""
    horizons = sorted({each.horizon_s for each in summary.errors})
    recordings = max(each.recordings for each in summary.errors)
    table = Table(
        title=f"RMSE with future commands known ({recordings} recordings)",
        title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False,
    )  # fmt: skip
    for name in ("condition", "rollouts", "channel"):
        table.add_column(name, no_wrap=True)
    for horizon in horizons:
        table.add_column(f"{horizon:g} s", justify="right")
    values = {(e.condition, e.channel, e.horizon_s): e for e in summary.errors}
    for condition in dict.fromkeys(each.condition for each in summary.errors):
        for index, channel in enumerate(STATE_NAMES):
            found = [values.get((condition, channel, horizon)) for horizon in horizons]
            counts = [each.count for each in found if each is not None]
            table.add_row(
                (condition or "all") if index == 0 else "",
                str(max(counts)) if index == 0 and counts else "",
                f"{channel}, {console.REPORT_UNITS[index]}",
                *("-" if e is None else f"{e.value * REPORT_SCALE[index]:.4g}" for e in found),
                end_section=index == len(STATE_NAMES) - 1,
            )
    return table
