# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench concealed: how often `adk mismatch` is right."""

from __future__ import annotations

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.bench.concealed.score import Score


def concealed(
    cases: Annotated[
        Path | None, typer.Option(help="folder of cases, each with its label.json")
    ] = None,
    own: Annotated[
        bool, typer.Option("--own", help="make cases with the package's own plant instead")
    ] = False,
    limit: Annotated[int, typer.Option(help="with --own: this many, spread evenly; 0: all")] = 0,
    out: Annotated[
        Path | None, typer.Option(help="folder to keep the reports in, one a case")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """
    Score `adk mismatch` on cases in which something is concealed.

    Example: adk bench concealed --cases cases
    """
    from adk_ros.bench.concealed.run import run_all, run_own, summary

    if (cases is None) != own:
        raise UsageError("give --cases FOLDER or --own, one of the two")
    with tempfile.TemporaryDirectory() as folder, console.progress("cases") as bar:
        keep = out or Path(folder)
        scores = run_own(limit, keep, bar) if cases is None else run_all(cases, keep, bar)
    figures = summary(scores)
    if as_json:
        console.answer({"summary": figures, "cases": [asdict(s) for s in scores]})
        return
    for s in scores:
        console.output.print(_line(s), markup=False)
    for name, value in figures.items():
        console.output.print(f"{name:<24} {value:.4g}", markup=False)


def _line(s: Score) -> str:
    """One case on one line."""
    parts = [f"{s.case}  {s.right:.2f}  {s.label}  ->  {s.said}"]
    parts += [f"{name} off by {100.0 * x:.1f} %" for name, x in s.errors.items()]
    parts += [f"IoU {x:.2f}" for x in s.iou.values()]
    if s.removed:
        gone = ", ".join(f"{name} {100.0 * x:.0f} %" for name, x in s.removed.items())
        parts.append(f"removed {gone}")
    parts.append(f"{s.cpu_s:.0f} s CPU, {s.memory_mib:.0f} MiB")
    if s.failure:
        parts.append(s.failure)
    return "; ".join(parts)
