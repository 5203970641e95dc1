# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk echo: the predictions of a running node, one per line."""

from __future__ import annotations

from typing import Annotated

import typer

from adk_ros.cli.options import JsonOption


def echo(
    topic: Annotated[
        str | None,
        typer.Option(help="topic to listen to", show_default="the only predicted_twist"),
    ] = None,
    node: Annotated[
        str | None, typer.Option(help="name of the predictor to listen to, if several run")
    ] = None,
    every: Annotated[int, typer.Option(help="print every N-th prediction")] = 10,
    count: Annotated[int | None, typer.Option(help="stop after N lines")] = None,
    duration: Annotated[float | None, typer.Option(help="stop after this many seconds")] = None,
    wait: Annotated[float, typer.Option(help="seconds to wait for a predictor")] = 10.0,
    as_json: JsonOption = False,
) -> None:
    """
    Print the predictions of a running node, one per line.

    Speeds are in km/h and yaw rates in deg/s; with --json all values are in SI units.

    Example: adk echo --every 40
    """
    from adk_ros.ros.echo import echo as run

    run(
        topic,
        predictor=node,
        count=count,
        duration_s=duration,
        as_json=as_json,
        every=every,
        wait_s=wait,
    )
