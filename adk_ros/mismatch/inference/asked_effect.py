# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Result types of a question for one effect: its fits, and what would decide about it."""

from __future__ import annotations

from dataclasses import dataclass

from adk_ros.mismatch.inference.experiment_design import Discriminability
from adk_ros.mismatch.inference.interval import Interval

FORMULA = "the formula of the unexplained residual"


@dataclass(frozen=True)
class AskedFit:
    """
    One fit of an effect, alone or next to others.

    `segments` in m along the lap, `onset_s`: where or from when it acts, if not always. `gain`:
    penalised gain in loss; `required`: what the selection demands of it. `share`: removed share of
    the excess loss before any effect. `is_nonzero`: its interval excludes zero effect;
    `is_significant`: among all that was examined. `detectable`: by parameter, the size from which
    it would be claimed; None beyond the range of the search. `more_driving`: factor on the
    duration of driving of this kind with which the fitted size would be claimed; None if none.
    """

    parameters: dict[str, Interval]
    kind: str
    segments: tuple[tuple[float, float], ...]
    onset_s: float | None
    gain: float
    required: float
    share: float
    is_material: bool
    is_nonzero: bool
    is_significant: bool
    detectable: dict[str, float | None]
    more_driving: float | None

    @property
    def suffices(self) -> bool:
        """Whether gain and size are what the selection demands."""
        return self.gain > self.required and self.is_material and self.is_significant


@dataclass(frozen=True)
class AskedEffect:
    """
    The answer to "why is this effect claimed, or not?".

    `alone`: fitted next to no other effect; `added`: next to `next_to`, the other identified
    effects (`FORMULA` for the terms of an unexplained residual); None if no fit is possible.
    `tied_with`: the identified effect that it fits as well as. `distinguishing`: the best
    simulated manoeuvre for it, None for an effect at a place; against no effect if
    `distinguishing.other` is the effect itself.
    """

    name: str
    claimed: bool
    reason: str
    next_to: tuple[str, ...] = ()
    alone: AskedFit | None = None
    added: AskedFit | None = None
    tied_with: str = ""
    distinguishing: Discriminability | None = None

    @property
    def decisive(self) -> AskedFit | None:
        """The fit that decides: next to the identified effects if there are any."""
        return self.added if self.next_to else self.alone
