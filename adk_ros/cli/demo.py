# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk demo: train, predict live, compare, score."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    out: Annotated[
        Path, typer.Option(help="folder for all results; only an earlier demo is replaced")
    ] = Path("demo_out"),
    train_bag: Annotated[Path, typer.Option(help="recording to train on")] = Path("bags/handling"),
    play_bag: Annotated[Path, typer.Option(help="recording to play live")] = Path("bags/town"),
    steps: Annotated[int, typer.Option(help="training steps")] = 1500,
) -> None:
    """
    Run the demo: train, predict live, score (about 4 min).

    Starts the real ROS node in a separate process and plays a recording to it in real time. The
    duration is for an AMD EPYC, 2 cores.

    Example: adk demo --out demo_out
    """
    from adk_ros.cli.demonstration import run_demo

    run_demo(out, train_bag, play_bag, steps)
