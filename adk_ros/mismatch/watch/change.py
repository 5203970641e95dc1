# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the watch reports: a change, as a sentence and as the content of a JSON message."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from adk_ros.mismatch.inference.result import EXPLAINED, IdentifiedEffect
from adk_ros.mismatch.report.effect_text import effect_text
from adk_ros.mismatch.report.json_values import (
    json_competing_effects,
    json_number,
    json_parameters,
)
from adk_ros.mismatch.report.vocabulary import CHANNEL_TITLES, listed

PRELIMINARY, FINAL, WITHDRAWN = "preliminary", "final", "withdrawn"
SCHEMA = 2
"""Version of the message; 1: another name of `competing_effects`."""


@dataclass(frozen=True)
class Change:
    """
    A change of the car against the reference of the drive.

    Times are seconds from `start_ns`, the stamp of the first reading. `verdict` as offline:
    explained, or unknown if the best effect leaves too much. `best`: that effect. `excess_ratio`:
    what it leaves, over what an explained change may leave. `channels`: those whose residuals
    rose most. `number` counts the changes of a drive from 1.
    """

    number: int
    state: str
    verdict: str
    best: IdentifiedEffect
    onset_s: float
    onset_low_s: float
    onset_high_s: float
    alarm_s: float
    until_s: float
    statistic: float
    threshold: float
    excess_ratio: float
    channels: tuple[str, ...]
    start_ns: int

    def stamp_ns(self, at_s: float) -> int:
        """Return the stamp of a time."""
        return self.start_ns + round(at_s * 1e9)

    def sentence(self) -> str:
        """Return the change in a sentence."""
        since = f"since {self.onset_s:.1f} s ({self.onset_low_s:.1f} to {self.onset_high_s:.1f} s)"
        if self.state == WITHDRAWN:
            return f"The change {since} is withdrawn: later data do not confirm it."
        if self.verdict == EXPLAINED:
            return f"Compared with the start of the drive: {effect_text(self.best)}."
        channels = listed([CHANNEL_TITLES[name] for name in self.channels])
        return (
            f"The car has changed {since}, and no effect of the catalogue explains it: the "
            f"residuals of {channels} have risen most. The closest is {effect_text(self.best)}."
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the JSON message; effects as in `mismatch.json`."""
        explained = self.verdict == EXPLAINED
        effect = _effect(self.best)
        return {
            "schema": SCHEMA,
            "number": self.number,
            "state": self.state,
            "verdict": self.verdict,
            "effects": [effect] if explained else [],
            "closest": [] if explained else [effect],
            "onset": {
                "stamp_ns": self.stamp_ns(self.onset_s),
                "low_ns": self.stamp_ns(self.onset_low_s),
                "high_ns": self.stamp_ns(self.onset_high_s),
            },
            "alarm_ns": self.stamp_ns(self.alarm_s),
            "until_ns": self.stamp_ns(self.until_s),
            "statistic": json_number(self.statistic),
            "threshold": json_number(self.threshold),
            "excess_ratio": json_number(self.excess_ratio),
            "channels": list(self.channels),
            "sentence": self.sentence(),
        }


def _effect(effect: IdentifiedEffect) -> dict[str, Any]:
    return {
        "name": effect.effect.name,
        "confidence": json_number(effect.confidence),
        "posterior": {name: json_number(x) for name, x in effect.posterior.items()},
        "alternatives": effect.alternatives,
        "parameters": json_parameters(effect.parameters),
        "equations": list(effect.effect.equations),
        "competing_effects": json_competing_effects(effect.competitors),
    }
