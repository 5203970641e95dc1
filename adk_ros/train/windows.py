# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Training data that do not fit into memory together: windows, of which one is in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from adk_ros.signals.channels import Record


@dataclass(frozen=True)
class TrainingWindows:
    """
    Training data in `count` windows, which a training uses one after the other.

    `read(number)` returns the records of a window, always the same ones; `key`: hash of what it
    returns, so that a checkpoint of other data is not resumed.
    """

    count: int
    key: str
    read: Callable[[int], list[Record]]

    def of_step(self, step: int, steps: int) -> int:
        """Return the number of the window that a step of a training of `steps` draws from."""
        return step * self.count // steps

    def mapped(self, change: Callable[[Record], Record]) -> TrainingWindows:
        """Return windows of changed records."""
        return replace(self, read=lambda number: [change(r) for r in self.read(number)])
