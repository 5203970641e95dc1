# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk play: a bag on ROS topics, in real time, with the clock."""

from __future__ import annotations

from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import BagArgument, JsonOption
from adk_ros.errors import UsageError


def play(
    bag: BagArgument,
    rate: Annotated[float, typer.Option(help="speed relative to real time")] = 1.0,
    clock: Annotated[bool, typer.Option(help="publish /clock")] = True,
    loop: Annotated[bool, typer.Option("--loop", help="start again at the end")] = False,
    start: Annotated[float, typer.Option(help="seconds into the bag to start at")] = 0.0,
    duration: Annotated[float | None, typer.Option(help="seconds to play")] = None,
    remap: Annotated[
        list[str] | None, typer.Option(help="FROM:=TO, renames a topic (repeatable)")
    ] = None,
    stamps: Annotated[
        str, typer.Option(help="header stamps: original, or now to shift them to the present")
    ] = "original",
    topic: Annotated[
        list[str] | None, typer.Option(help="play only this topic (repeatable)")
    ] = None,
    wait: Annotated[float, typer.Option(help="seconds to wait for a subscriber")] = 10.0,
    as_json: JsonOption = False,
) -> None:
    """
    Publish a recording on ROS topics in real time.

    Example: adk play bags/town --remap /imu/data:=/imu --remap /vehicle/command:=/command
    """
    from adk_ros.ros.play import play as run

    pairs = [item.split(":=") for item in remap or []]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise UsageError("--remap needs FROM:=TO, for instance /imu/data:=/imu")
    with console.progress(f"playing {bag.name}") as report:
        stats = run(
            bag,
            rate,
            clock=clock,
            loop=loop,
            remap={old: new for old, new in pairs},
            stamps=stamps,
            topics=topic,
            start_s=start,
            duration_s=duration,
            wait_for_subscribers_s=wait,
            progress=report,
            notice=console.note,
        )
    if as_json:
        console.print_json(stats.to_json())
        return
    console.note(
        f"{stats.messages} messages, {stats.played_s:.1f} s; lateness "
        f"{stats.lateness_p50_ms:.2f} ms (median), {stats.lateness_p99_ms:.2f} ms (p99)"
    )
