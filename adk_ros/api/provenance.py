# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Provenance of a result: reads the clock and the version, which the layers below do not."""

from __future__ import annotations

import time
from collections.abc import Iterable
from contextvars import ContextVar
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path

from adk_ros.files.pages.provenance import Provenance, input_files

COMMAND_LINE: ContextVar[str] = ContextVar("adk_ros_command_line", default="Python interface")
"""The command line that runs; `adk` sets it."""


class RunTimer:
    """The date and time at which a run started; create it before the work begins."""

    def __init__(self) -> None:
        self._started = datetime.now(timezone.utc)
        self._monotonic_s = time.monotonic()

    def provenance(self, inputs: Iterable[tuple[str, Path | str | None]]) -> Provenance:
        """
        Return the provenance of a result from `inputs`, pairs of role and path; None is skipped.

        :raises UsageError: an input cannot be read.
        """
        files = tuple(
            file
            for role, path in inputs
            if path is not None
            for file in input_files(role, Path(path))
        )
        return Provenance(
            COMMAND_LINE.get(),
            _version(),
            self._started.strftime("%Y-%m-%d %H:%M:%S UTC"),
            time.monotonic() - self._monotonic_s,
            files,
        )


def _version() -> str:
    try:
        return metadata.version("adk_ros")
    except metadata.PackageNotFoundError:
        return "unknown"
