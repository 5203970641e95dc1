# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk watch: which physics of a running car has changed."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import ParamsOption, read_options


def watch(
    model: Annotated[
        Path, typer.Option(help="simulation.yaml or corrected.yaml of an 'adk mismatch' report")
    ],
    simulation: Annotated[
        Path | None,
        typer.Option(
            help="simulation.yaml with the model's error on the simulation, which a "
            "corrected.yaml does not hold",
            show_default="the one next to --model",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="folder for the evidence of each change", show_default="none"),
    ] = None,
    run: Annotated[
        bool, typer.Option("--run", help="analyse the evidence with 'adk mismatch' at once")
    ] = False,
    imu: Annotated[str, typer.Option(help="IMU topic")] = "imu",
    odometry: Annotated[str, typer.Option(help="odometry topic")] = "odometry",
    command: Annotated[str, typer.Option(help="command topic")] = "command",
    namespace: Annotated[
        str, typer.Option(help="namespace of the node, such as /car1", show_default="none")
    ] = "",
    params: ParamsOption = None,
    duration: Annotated[
        float | None, typer.Option(help="stop after this many seconds", show_default="never")
    ] = None,
) -> None:
    """
    Watch a running car, and name the physics that changes.

    A node that compares the car with the model all the time. It learns the car for two minutes of
    driving; then it names what changes, since when and how much, on ~/change (JSON) and in
    /diagnostics. With --out it writes a bag of the minutes around each change and the command
    that analyses it.

    Example: adk watch --model report/corrected.yaml --out changes
    """
    from adk_ros.errors import UsageError
    from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
    from adk_ros.mismatch.report.result_files import SIMULATION_FILE
    from adk_ros.mismatch.watch.watched_model import watched_surrogate
    from adk_ros.ros.unread_output import STDERR, STDOUT, discard_unread_output

    for descriptor in (STDOUT, STDERR):
        discard_unread_output(descriptor)
    if run and out is None:
        raise UsageError("--run analyses the evidence: name a folder for it with --out")
    if duration is not None and not duration > 0.0:
        raise UsageError(f"--duration is {duration:g}: choose a positive number of seconds")
    sensors = read_options(None, None, None, False, params).sensors
    loaded = load_surrogate(model)
    nearby = model.parent / SIMULATION_FILE
    known = simulation or (nearby if nearby.is_file() and nearby != model else None)
    surrogate, notes = watched_surrogate(loaded, load_surrogate(known) if known else None)
    for text in notes:
        console.note(text)

    from adk_ros.ros.watch_node import WatchOptions, source_topics
    from adk_ros.ros.watch_node import watch as run_node

    options = WatchOptions(
        source_topics(imu, odometry, command), sensors, namespace, out, run_mismatch=run
    )
    if run_node(surrogate, options, console.note, duration):
        # The interpreter may take seconds to free what it holds; nothing is left to be written.
        console.flush()
        os._exit(0)
