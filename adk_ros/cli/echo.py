# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk echo: the predictions of a running node, a line each."""

from __future__ import annotations

from typing import Annotated

import typer

from adk_ros.cli.options import JsonOption


def echo(
    topic: Annotated[
        str | None, typer.Option(help="default: the only predicted_twist there is")
    ] = None,
    every: Annotated[int, typer.Option(help="print one in so many")] = 10,
    count: Annotated[int | None, typer.Option(help="end after so many lines")] = None,
    duration: Annotated[float | None, typer.Option(help="end after so many seconds")] = None,
    wait: Annotated[float, typer.Option(help="seconds to wait for a predictor")] = 10.0,
    as_json: JsonOption = False,
) -> None:
    """
    Print the predictions of a running node, a line each.

    Speeds are in km/h, yaw rates in deg/s; with --json all is SI.

    Example: adk echo --every 40
    """
    from adk_ros.ros.echo import echo as run

    run(topic, count=count, duration_s=duration, as_json=as_json, every=every, wait_s=wait)
