# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Folders that the processes of one test run share, each made by the first that needs it."""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

_VARIABLE = "ADK_ROS_TEST_SHARED"
"""Environment variable with the path; the workers of pytest-xdist inherit it."""


def create() -> Path:
    """Create the shared folder of this run."""
    folder = Path(tempfile.mkdtemp(prefix="adk_ros_test_"))
    os.environ[_VARIABLE] = str(folder)
    return folder


def remove() -> None:
    """Remove the shared folder of this run."""
    shutil.rmtree(os.environ.pop(_VARIABLE), ignore_errors=True)


def made_once(name: str, make: Callable[[Path], object]) -> Path:
    """
    Return the shared folder `name`; the first caller fills it with `make(folder)`.

    Callers in other processes wait for it. A `make` that fails leaves nothing, so the next caller
    starts over.
    """
    root = Path(os.environ[_VARIABLE])
    made = root / name
    with (root / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            unfinished = Path(tempfile.mkdtemp(dir=root))
            try:
                make(unfinished)
                unfinished.rename(made)
            finally:
                shutil.rmtree(unfinished, ignore_errors=True)
    return made
