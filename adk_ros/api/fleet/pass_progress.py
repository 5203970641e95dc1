# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Progress of an analysis in passes: its texts begin with the number of the pass."""

from __future__ import annotations

from adk_ros.fleet.run import Progress


class PassProgress:
    """
    A progress callback that puts "pass 2 of at most 6, " before the texts.

    Each pass counts its recordings from zero, and hashes those that are new first.
    """

    def __init__(self, progress: Progress | None) -> None:
        self._progress, self._begin = progress, ""

    def begin_pass(self, number: int, most: int) -> None:
        """Name a pass, from 1 on, of at most `most`, in the texts from now on."""
        self._begin = f"pass {number} of at most {most}, "

    def __call__(self, done: float, total: float, text: str) -> None:
        """Report what is done of a step, as the callback that is given."""
        if self._progress is not None:
            self._progress(done, total, f"{self._begin}{text}")

    def of_analysis(self, done: float, text: str) -> None:
        """Report the share of a step that is done."""
        self(done, 1.0, text)
