# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of `adk fleet`: what one would do, as text, and what is said when one is interrupted."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer

from adk_ros.cli import console


@contextmanager
def continued_later() -> Iterator[None]:
    """End a run at a signal as `graceful_shutdown`, and say that its results are kept."""
    from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown

    try:
        with graceful_shutdown():
            yield
    except (Terminated, KeyboardInterrupt) as stop:
        console.note("results so far are kept: run the same command again to continue")
        if isinstance(stop, KeyboardInterrupt):
            raise
        raise typer.Exit(TERMINATED) from None


def print_estimate(estimate: dict[str, Any], as_json: bool, further: str = "") -> None:
    """Print `FleetEstimate.as_dict()`, and what comes after the stage."""
    if as_json:
        console.print_json(estimate)
    else:
        console.output.print(_estimate_text(estimate) + further, markup=False)
        console.note_all(estimate["notes"])


def _estimate_text(estimate: dict[str, Any]) -> str:
    from adk_ros.fleet.run import duration_text

    text = (
        f"{estimate['stage']}: {estimate['total']} recordings, {estimate['reused']} done, "
        f"{estimate['missing']} to process ({estimate['bytes'] / 1e6:.1f} MB)"
    )
    if estimate["unhashed"]:
        text += f", {estimate['unhashed']} of them new"
    if not estimate["workers"]:
        return f"{text}; duration unknown: no worker is connected to the scheduler"
    if estimate["seconds"] is None:
        return f"{text}; duration unknown before the first result"
    text += f"; about {duration_text(estimate['seconds'])} with {estimate['workers']} workers"
    return f"{text}, by {estimate['basis']}" if estimate["basis"] else text
