# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk demo: the whole product in one go, on the bags that come with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    out: Annotated[Path, typer.Option(help="folder for all that is made")] = Path("demo_out"),
    train_bag: Annotated[Path, typer.Option(help="recording to train on")] = Path("bags/handling"),
    play_bag: Annotated[Path, typer.Option(help="recording to play live")] = Path("bags/town"),
    steps: Annotated[int, typer.Option(help="training steps")] = 1500,
) -> None:
    """
    The whole product in one go: train, predict live, score, draw.

    The real node runs in a process of its own, and a recording is played to it in real time.

    Example: adk demo --out demo_out
    """
    from adk_ros.cli.demonstration import run_demo

    run_demo(out, train_bag, play_bag, steps)
