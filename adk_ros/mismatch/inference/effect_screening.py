# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Screening of effects for one more in a hypothesis, by linearised gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from adk_ros.mismatch.inference.change_points import locate_change_point
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.score_test import Candidate, LinearisedProblem
from adk_ros.mismatch.inference.segments import fit_segments
from adk_ros.mismatch.inference.selection_path import SelectionPath, only_direction
from adk_ros.mismatch.library.criteria import ONSET_MIN_FURTHER_GAIN
from adk_ros.mismatch.library.effect import ALWAYS, PLACE, TIME
from adk_ros.mismatch.library.sensitivity import decided
from adk_ros.mismatch.surrogate.lap import Lap


@dataclass
class EffectScreening:
    """Candidates of one extension: active throughout, from an onset on, in segments."""

    always: list[Candidate] = field(default_factory=list)
    onset: list[Candidate] = field(default_factory=list)
    segments: list[Candidate] = field(default_factory=list)

    def leading(
        self,
        candidates: Sequence[Candidate],
        free: Sequence[int],
        least: float,
        share: float,
        count: int,
    ) -> list[ActiveEffect]:
        """
        Return the candidates with the largest linearised gains above `least`, at most `count`.

        And above `share` of the best one. Those that act in a direction in which no effect does
        yet are compared, and counted, among themselves: less is asked of them.
        """
        groups: dict[int | None, list[Candidate]] = {}
        for x in candidates:
            groups.setdefault(_group(x, free), []).append(x)
        out = []
        for group, members in groups.items():
            every = (*self.always, *self.onset, *self.segments)
            best = max(x.gain for x in every if group is None or _group(x, free) == group)
            enough = [x for x in members if x.gain > max(least, share * best)]
            out += sorted(enough, key=lambda x: -x.gain)[:count]
        return [x.active for x in out]


def screened_effects(
    linearised: LinearisedProblem, lap: Lap | None, path: SelectionPath
) -> EffectScreening:
    """Return the candidates for one more effect; adds spatial profiles to `path`."""
    start = linearised.hypothesis
    single = not start.effects
    excluded = {*start.names, *linearised.likelihood.unobservable}
    out = EffectScreening()
    for effect in linearised.likelihood.effects.values():
        if effect.name in excluded:
            continue
        if ALWAYS in effect.activations:
            screened = linearised.screen_effect(effect)
            out.always += screened if single else screened[:1]
            onset = (
                locate_change_point(linearised, screened[0].active)
                if TIME in effect.activations
                else None
            )
            if onset is not None and _acts_from_onset(onset.gain, screened[0].gain):
                out.onset.append(onset)
        if lap is not None and PLACE in effect.activations:
            candidate, profile = fit_segments(linearised, effect, lap)
            path.profiles.append(profile)
            out.segments += [candidate] if candidate is not None else []
    return out


def _acts_from_onset(gain: float, gain_throughout: float) -> bool:
    """Whether an effect from an onset on gains far more than throughout."""
    return bool(
        decided(
            lambda further: gain > (1.0 + further) * gain_throughout,
            ONSET_MIN_FURTHER_GAIN=ONSET_MIN_FURTHER_GAIN,
        )
    )


def _group(candidate: Candidate, free: Sequence[int]) -> int | None:
    """Return the free direction in which alone a candidate acts, None if there is none."""
    direction = only_direction(candidate.active.effect)
    return direction if direction in free else None
