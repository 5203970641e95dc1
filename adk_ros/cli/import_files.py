# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk import: tables, MDF4, CAN logs and bags of other messages as a bag."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import ForceOption, JsonOption
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.api.importing import ImportResult

_MAX_NAMED = 12
"""Columns without a channel that are named on the terminal."""


def import_files(
    files: Annotated[
        list[Path],
        typer.Argument(help="CSV, Parquet, MAT, MDF (.mf4), CAN log (.blf, .asc, .log) or bag"),
    ],
    map_: Annotated[
        Path | None,
        typer.Option("--map", help="YAML file: which column is which channel, in which unit"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="bag to write; with --propose: map to write")
    ] = None,
    propose: Annotated[
        bool, typer.Option("--propose", help="propose a map instead of importing")
    ] = False,
    dbc: Annotated[
        list[Path] | None, typer.Option(help="messages of a CAN log (may be repeated)")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Import recordings of other formats as a bag.

    Several files of one drive are joined by their times; each message keeps the stamps of its
    source. Write a first map with --propose, correct it, and import with --map.

    Example: adk import drive.csv --map map.yaml --out drive
    """
    if propose:
        if map_ is not None:
            raise UsageError("--propose writes a map: leave out --map")
        _propose(files, out, dbc or [], force, as_json)
        return
    if map_ is None:
        raise UsageError("give --map YAML, or write a first one with --propose --out map.yaml")
    if out is None:
        raise UsageError("give --out BAG, the bag to write")
    from adk_ros.api.importing import import_recording

    with console.stages() as progress:
        result = import_recording(
            list(files), map_, out, dbc=dbc or [], force=force, progress=progress
        )
    if as_json:
        console.print_json(result.as_dict())
        return
    _print_result(result)


def _propose(
    files: list[Path], out: Path | None, dbc: list[Path], force: bool, as_json: bool
) -> None:
    from adk_ros.api.importing import propose_map
    from adk_ros.api.output import check_output

    if out is not None:
        check_output(out, force, None, *files, *dbc)
    proposal = propose_map(list(files), dbc=dbc)
    if out is not None:
        out.write_text(proposal.text, encoding="utf-8")
    if as_json:
        console.print_json(proposal.as_dict() | {"out": None if out is None else str(out)})
        return
    if out is None:
        print(proposal.text, end="")
        return
    console.note(
        f"{len(proposal.guesses)} channels proposed in {out}, {len(proposal.uncertain)} to check "
        f"({', '.join(proposal.uncertain) or 'none'})"
    )
    inputs = " ".join([*map(str, files), *(f"--dbc {path}" for path in dbc)])
    console.note(f"next: adk import {inputs} --map {out} --out BAG")


def _print_result(result: ImportResult) -> None:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    content = result.content
    console.note_all(content.notes)
    table = Table(box=box.SIMPLE_HEAD, padding=0)
    for heading in ("channel", "source", "unit", "factor", "Hz", "count", "range"):
        is_number = heading in {"factor", "Hz", "count"}
        table.add_column(heading, justify="right" if is_number else "left", no_wrap=not is_number)
    for row in content.rows():
        span = f"{row['min']:.4g} to {row['max']:.4g} {row['si_unit']}"
        table.add_row(
            row["channel"],
            # `[g]` in a name is no markup.
            escape(row["source"] if len(row["source"]) <= 28 else f"...{row['source'][-25:]}"),
            escape(row["unit"]),
            f"{row['factor']:.6g}",
            f"{row['rate_hz']:.4g}",
            str(row["count"]),
            span if row["not_imported"] is None else "not imported",
        )
    console.print_table(table)
    for name, reason in result.not_imported.items():
        console.warn(f"{name} is not imported: {reason}")
    if content.unused:
        more = len(content.unused) - _MAX_NAMED
        names = ", ".join(content.unused[:_MAX_NAMED]) + (f" and {more} more" if more > 0 else "")
        console.note(f"columns that the map does not name: {names}")
    console.flush()
    console.note(
        f"{content.duration_s:.1f} s, {content.message_count} messages of "
        f"{len(content.outcome.topics)} topics in {result.out}"
    )
    console.note(f"next: adk info {result.out}")
