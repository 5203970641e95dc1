# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processes of a measurement over ROS topics, in a domain of their own on this machine."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any


def start_process(
    stack: ExitStack, folder: Path, module: str, *arguments: str
) -> subprocess.Popen[str]:
    """Start `python -m module arguments`, which ends with `stack`; its errors go to `folder`."""
    # A separate domain, local only: a robot on this network must not receive any of this.
    environment = {
        **os.environ,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(60 + os.getpid() % 40),
    }
    errors = stack.enter_context((folder / f"{arguments[0].strip('-')}.err").open("w"))
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
    )
    stack.callback(end_process, process)
    return process


def end_process(process: subprocess.Popen[str]) -> None:
    """End a process, after 5 s by force."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    if process.stdout is not None:
        process.stdout.close()


def cpu_seconds(process: Any) -> float:
    """Return the CPU time of a `psutil.Process`, s."""
    times = process.cpu_times()
    return float(times.user + times.system)


def last_error(folder: Path, name: str = "*") -> str:
    """Return the last line that a process wrote to stderr; `name`: its first argument."""
    lines = [
        line
        for path in sorted(folder.glob(f"{name}.err"))
        for line in path.read_text().splitlines()
    ]
    return lines[-1] if lines else "no reason was given"
