# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Episodes of residuals beyond the Huber threshold, and whether they are material.

Seconds with such residuals are compared with what accidents and the surrogate's own error cause.
Accidents follow a Poisson distribution with a mean of one per recording. With k such seconds on
the simulation, which is 1 / e times as long, and Jeffreys' prior on their rate, those on the
recording follow a negative binomial distribution of k + 1/2 failures with probability
1 / (1 + e): a rate is not known to be zero because the simulation happens to have none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import nbinom, poisson

from adk_ros.mismatch.library.criteria import (
    ACCIDENTAL_SECONDS,
    DOWNWEIGHTED_FALSE_ALARM,
    FEATURE_MAJORITY_SHARE,
)

_MAX_EPISODES_SHARE = 0.5
"""Share of a recording above which such residuals are the rule, and no episodes."""
_JEFFREYS = 0.5
"""Shape of Jeffreys' prior on the rate of a Poisson distribution."""


class Episode(NamedTuple):
    """
    Consecutive residuals beyond the Huber threshold, alone or together.

    `channel`: that of the largest one, of `size` in SI and `sigmas` standard deviations; if none
    exceeds the threshold alone, mean and its standard deviations of the channel in which it is
    largest. `x`, `y`: position there, m; `lap_m`: distance along the lap, None
    without one or off it. `share`: part of Huber's loss of the recording that is in it, above that
    of noise.
    """

    begin_s: float
    end_s: float
    channel: str
    size: float
    sigmas: float
    x: float
    y: float
    lap_m: float | None
    share: float = 0.0


@dataclass(frozen=True)
class Downweighted:
    """
    Residuals of a recording, or means of some, beyond what noise causes; `episodes` by time.

    The name is older than the means, whose residuals the loss does not downweight.

    `seconds`: their duration, of each at least one; `simulated`: the same of the simulation;
    `exposure`: duration of the recordings over that of the simulation; `recordings`: their number.
    `share`: part of Huber's loss that is in episodes, above that of noise. `equations`: those that
    it concerns, largest part first.
    """

    episodes: tuple[Episode, ...]
    seconds: int
    simulated: int
    exposure: float
    recordings: int
    share: float
    equations: tuple[str, ...]
    counted_s: float = np.inf
    """Seconds of the recordings that count."""
    share_of_excess: float = 1.0
    """Part of the loss above that of noise that is in episodes."""

    @property
    def share_of_time(self) -> float:
        """Share of the seconds that count which is in episodes."""
        return min(self.seconds / max(self.counted_s, 1.0), 1.0)

    @property
    def is_rule(self) -> bool:
        """Whether they take more than half of the recording: no episodes, but the rule."""
        return self.share_of_time > _MAX_EPISODES_SHARE

    @property
    def is_most(self) -> bool:
        """Whether most of what noise does not cause is in episodes."""
        return self.share_of_excess > FEATURE_MAJORITY_SHARE

    def describes(self, something_is_unexplained: bool) -> bool:
        """Whether material episodes say what is unexplained, if something is known to be."""
        return self.is_material and (self.is_most or not something_is_unexplained)

    @property
    def expected(self) -> float:
        """Seconds that the rate of the simulation gives for the recordings."""
        return self.simulated * self.exposure

    @property
    def is_material(self) -> bool:
        """Whether accidents and the surrogate's own error do not explain so many."""
        return self.chance() < DOWNWEIGHTED_FALSE_ALARM

    def chance(self) -> float:
        """Return the probability of as many seconds or more without physics of the car."""
        rate = (self.simulated + _JEFFREYS, 1.0 / (1.0 + self.exposure))
        of_surrogate = np.arange(self.seconds)
        mean = ACCIDENTAL_SECONDS * self.recordings
        accidents = poisson.sf(self.seconds - 1 - of_surrogate, mean)
        both = float(nbinom.pmf(of_surrogate, *rate) @ accidents)
        return both + float(nbinom.sf(self.seconds - 1, *rate))

    def text(self) -> str:
        """Return number, duration and largest episode in words."""
        if self.is_rule:
            return f"{100.0 * self.share_of_time:.0f} % of the seconds"
        largest = max(self.episodes, key=lambda x: x.sigmas)
        durations = [x.end_s - x.begin_s for x in self.episodes]
        lasting = f"{min(durations):.2g} to {max(durations):.2g} s"
        count = f"{len(self.episodes)} episodes of {lasting}, the largest"
        if len(self.episodes) == 1:
            count = f"an episode of {durations[0]:.2g} s"
        return f"{count} at {largest.begin_s:.1f} s"
