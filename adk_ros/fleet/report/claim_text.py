# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Claims of a fleet as phrases with physical sizes, as the report of a single recording has."""

from __future__ import annotations

import math
from dataclasses import dataclass

from adk_ros.fleet.inference.fleet_result import Claim, NotClaimed, PlaceClaim
from adk_ros.mismatch.inference.result import Interval
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.report.effect_text import interval_text, phrase, phrase_size
from adk_ros.mismatch.report.effect_vocabulary import THAN
from adk_ros.mismatch.report.vocabulary import quantity


@dataclass(frozen=True)
class ClaimText:
    """`phrase`: "5.1 % softer rear tyres"; `interval`: "4.4 to 5.7 %"."""

    phrase: str
    interval: str


def claim_text(claim: Claim | NotClaimed | PlaceClaim) -> ClaimText:
    """Return an effect relative to the simulation, with its 90 % interval in the same unit."""
    effect = EFFECTS[claim.effect]
    (parameter,) = (p for p in effect.parameters if p.name == claim.parameter)
    # A claim is a difference from neutral, of an inverse parameter the value itself.
    shift = 0.0 if parameter.inverse else parameter.neutral
    value, low, high = (shift + each for each in (claim.size, claim.low, claim.high))
    sized = Interval(value, low, high, parameter.unit)
    text = phrase(effect, value).removesuffix(THAN).rstrip(",")
    if "{size}" not in text:
        written = quantity(effect.name, parameter.name, parameter.unit)
        return ClaimText(f"{text}: {written.label} {interval_text(sized, written)}", "")
    size, interval = phrase_size(effect, sized)
    return ClaimText(text.format(size=size), interval)


def level_text(claim: Claim) -> str:
    """Return the level of a claim, of a change in time with the 90 % interval of its onset."""
    if claim.onset_low_day is None or claim.onset_high_day is None:
        return claim.level
    low, high = claim.onset_low_day, claim.onset_high_day
    # To a tenth of the interval's width.
    decimals = max(0, math.ceil(1.0 - math.log10(max(high - low, 0.01))))
    return f"{claim.level}, onset between day {low:.{decimals}f} and {high:.{decimals}f}"
