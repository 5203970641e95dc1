# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of `adk fleet mismatch`, written again from its result."""

from __future__ import annotations

from pathlib import Path

from adk_ros.api.fleet.fleet_mismatch import REPORT
from adk_ros.errors import UsageError
from adk_ros.fleet.report.file_names import DATA
from adk_ros.fleet.run_lock import run_lock


def rewrite_report(out: Path | str) -> Path | None:
    """
    Write the page of `fleet_mismatch` again from the result in `out`, without any analysis.

    Returns its path; None if `out` has no such result. The result stays as it is.

    :raises DataError: the result is damaged, or of another version of adk_ros.
    :raises UsageError: `out` is in use, or cannot be written.
    """
    folder = Path(out) / REPORT
    if not (folder / DATA).is_file():
        return None
    from adk_ros.fleet.report.fleet_page import rewrite_fleet_page

    with run_lock(Path(out)):
        try:
            return rewrite_fleet_page(folder)
        except OSError as error:
            raise UsageError(f"{folder} cannot be written: {error.strerror or error}") from None
