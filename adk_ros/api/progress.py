# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the functions of the Python interface report progress."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float, float, str], None]
"""
Called with (stage, done, total, detail) while a function works.

`stage` names the current part of the work, `done` counts up to `total` within it, and `detail` is
a short text such as the loss, or empty.
"""


def in_stage(progress: Progress | None, stage: str) -> Callable[..., None]:
    """Return `report(done, total, detail="")`, which calls `progress` for one stage."""

    def report(done: float, total: float, detail: str = "") -> None:
        if progress is not None:
            progress(stage, done, total, detail)

    return report
