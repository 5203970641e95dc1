# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Episodes of residuals that the robust loss downweights, and whether they are material.

Seconds with such residuals are compared with a Poisson distribution whose mean is one accident per
recording plus the seconds that the surrogate is as wrong about the simulation in the same time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from scipy.stats import poisson

from adk_ros.mismatch.library.criteria import ACCIDENTAL_SECONDS, DOWNWEIGHTED_FALSE_ALARM


class Episode(NamedTuple):
    """
    Consecutive residuals beyond the Huber threshold.

    `channel`: that of the largest one, of `size` in SI and `sigmas` standard deviations. `x`, `y`:
    position there, m; `lap_m`: distance along the lap, None without one.
    """

    begin_s: float
    end_s: float
    channel: str
    size: float
    sigmas: float
    x: float
    y: float
    lap_m: float | None


@dataclass(frozen=True)
class Downweighted:
    """
    Downweighted residuals of a recording; `episodes` by time.

    `seconds` with such a residual; `expected`: as many has the simulation in the same time.
    `share`: part of the squared residuals that the robust loss does not count. `equations`: those
    that it concerns, largest part first.
    """

    episodes: tuple[Episode, ...]
    seconds: int
    expected: float
    share: float
    equations: tuple[str, ...]

    @property
    def is_material(self) -> bool:
        """Whether accidents and the surrogate's own error do not explain so many."""
        least = ACCIDENTAL_SECONDS + self.expected
        return bool(poisson.sf(self.seconds - 1, least) < DOWNWEIGHTED_FALSE_ALARM)

    def text(self) -> str:
        """Return number, duration and largest episode in words."""
        largest = max(self.episodes, key=lambda x: x.sigmas)
        durations = [x.end_s - x.begin_s for x in self.episodes]
        lasting = f"{min(durations):.2g} to {max(durations):.2g} s"
        count = f"{len(self.episodes)} episodes of {lasting}, the largest"
        if len(self.episodes) == 1:
            count = f"an episode of {durations[0]:.2g} s"
        return f"{count} at {largest.begin_s:.1f} s"
