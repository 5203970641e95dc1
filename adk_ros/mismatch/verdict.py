# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From the search's hypotheses to what is said: effects with intervals, or what is unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.ambiguity import Standing, better_name, standing
from adk_ros.mismatch.catalogue import EFFECTS
from adk_ros.mismatch.effect import PLACE, TIME
from adk_ros.mismatch.findings import (
    EXPLAINED,
    NONE,
    UNKNOWN,
    FoundEffect,
    Interval,
    Unexplained,
)
from adk_ros.mismatch.gates import EDGE
from adk_ros.mismatch.likelihood import Active, Hypothesis, Likelihood
from adk_ros.mismatch.search import Search, required
from adk_ros.mismatch.unknown import Remainder, describe, without_features

SYSTEMATIC = 0.012
"""Share of an effect's size by which it may be off however long the drive: no form is exact."""
COLOURED = 1.4
"""Factor on statistical deviations for what the whitening misses."""
QUANTILE = 1.645
"""Standard deviations to either side that hold 90 % of a normal variable."""

_LEFT_OF_NOISE, _LEFT_OF_ALL = 0.04, 0.06
"""Shares of the noise and of all that there was; where less is left, nothing is unexplained."""
_INEXACT = 0.35
"""Share of all that effects may leave if what is left depends on nothing."""
_SHAPELESS = 0.25
"""Share of the noise that must be left to be said where no effect and no feature lessens it."""
_SWAPS = 2
_SWAPPED = 8.0
"""A rival that is better by this much takes the place of what was found."""


@dataclass(frozen=True)
class Verdict:
    """What is said: the effects, the remainder, and the hypothesis that the figures are of."""

    word: str
    effects: list[FoundEffect]
    unexplained: Unexplained | None
    hypothesis: Hypothesis
    remainder: Remainder | None


def judge(likelihood: Likelihood, found: Search) -> Verdict:
    """Judge the search's best hypothesis."""
    best = found.best()
    remainder = _remainder(likelihood, found, best)
    if remainder is not None:
        kept = without_features(remainder.hypothesis)
        best = remainder.hypothesis
    else:
        kept = best.actives
    if not kept and remainder is None:
        return Verdict(NONE, [], None, best, None)
    edges = any(a.gate.kind in {PLACE, TIME} for a in kept)
    final = likelihood.fit(best.actives, best.tolerances, 6, None, 1e-6, edges=edges)
    final, standings = _settled(likelihood, _renamed(likelihood, final, edges), edges)
    worthy = _worthy(likelihood, final, edges)
    if len(worthy) < len(final.actives):
        final = likelihood.fit(worthy, final.tolerances, 6, None, 1e-6, edges=edges)
        final, standings = _settled(likelihood, final, edges)
    if not final.actives:
        return Verdict(NONE, [], None, final, None)
    deviation = _deviations(likelihood, final, edges)
    effects = [
        _effect(likelihood, active, deviation[i], standings[i])
        for i, active in enumerate(final.actives) if i in standings
    ]
    if remainder is None:
        return Verdict(EXPLAINED, effects, None, final, None)
    said = Unexplained(
        remainder.equations, round(remainder.share, 3), remainder.text(), remainder.expression(),
        remainder.pieces,
    )
    return Verdict(UNKNOWN, effects, said, final, remainder)


def _worthy(likelihood: Likelihood, h: Hypothesis, edges: bool) -> list[Active]:
    """
    Return what is worth a name: more than build tolerance, surely not nothing, and somewhere.

    Next to a large effect a small one may lessen the loss only because the large one's form is
    inexact: it is then of no sure size, or its place has shrunk to less than its own edges.
    """
    kept = []
    for active, deviation in zip(h.actives, _deviations(likelihood, h, edges), strict=True):
        sure = active.material() and any(
            abs(inner - parameter.inner_neutral) > QUANTILE * COLOURED * one
            for parameter, inner, one in zip(
                active.effect.parameters, active.inner, deviation, strict=True
            )
        )
        stretches = active.gate.stretches
        somewhere = not stretches or any(b - a > 2.0 * EDGE for a, b in stretches)
        if active.effect.name not in EFFECTS or (sure and somewhere):
            kept.append(active)
    return kept


def _settled(
    likelihood: Likelihood, h: Hypothesis, edges: bool
) -> tuple[Hypothesis, dict[int, Standing]]:
    """Return the hypothesis in which no rival does better than what it has, and how all stand."""
    for _ in range(_SWAPS + 1):
        standings = {
            i: standing(likelihood, h, i)
            for i, active in enumerate(h.actives) if active.effect.name in EFFECTS
        }
        ahead = [
            (r.behind, i, j) for i, s in standings.items() for j, r in enumerate(s.rivals)
            if r.fitted.material()
        ]
        behind, which, rival = min(ahead, default=(0.0, 0, 0))
        if behind > -_SWAPPED:
            break
        actives = list(h.actives)
        actives[which] = standings[which].rivals[rival].fitted
        h = likelihood.fit(actives, h.tolerances, 8, None, 1e-6, edges=edges)
    return h, standings


def _remainder(likelihood: Likelihood, found: Search, best: Hypothesis) -> Remainder | None:
    """Return what is left where that is material, described from nothing or from `best`."""
    left = best.cost - found.noise
    bound = any(
        x <= p.bounds()[0] + 1e-9 or x >= p.bounds()[1] - 1e-9
        for a in best.actives for p, x in zip(a.effect.parameters, a.inner, strict=True)
        if not p.inverse and x != p.inner_neutral
    )
    small = left < _LEFT_OF_NOISE * found.noise or left < _LEFT_OF_ALL * found.all
    if small and not best.actives:
        return None
    nothing = found.levels[0][0]
    plain = describe(likelihood, nothing, found.noise, found.all)
    if not best.actives:
        # What no effect and no feature lessens is the stand-in's own error on another route.
        return plain if plain.pieces or left > _SHAPELESS * found.noise else None
    if simpler(plain, best, found):
        return plain
    if small and not bound:
        return None
    if bound:
        return plain if plain.pieces else None
    more = describe(likelihood, best, found.noise, found.all)
    # Effects that a short expression does without were its disguise.
    rest_plain = plain.hypothesis.cost - found.noise
    rest_more = more.hypothesis.cost - found.noise
    if rest_plain < 1.5 * max(rest_more, _LEFT_OF_NOISE * found.noise):
        return plain
    # Effects that explain most, and what they leave depends on nothing: their form is inexact.
    if not more.pieces and left < _INEXACT * found.all:
        return None
    return more


def simpler(plain: Remainder, best: Hypothesis, found: Search) -> bool:
    """
    Whether an expression of no more terms than there are effects does better than these.

    A listed effect that is there meets the noise, and no expression can do more; of one that is
    not, several effects together are the disguise.
    """
    if not plain.pieces or len(plain.pieces) > len(best.actives):
        return False
    return plain.hypothesis.cost + required(best, found) < best.cost


def _renamed(likelihood: Likelihood, h: Hypothesis, edges: bool) -> Hypothesis:
    """Return the hypothesis with what is rather called by another name called so."""
    deviation = _deviations(likelihood, h, edges)
    actives = list(h.actives)
    changed = False
    for i, active in enumerate(actives):
        effect = better_name(active, tuple(deviation[i]))
        if effect is not active.effect:
            # Tilt by the biases: roll from a_y, pitch from a_x.
            inner = (active.inner[1] / 9.81, -active.inner[0] / 9.81)
            actives[i] = Active(effect, inner, active.gate)
            changed = True
    if not changed:
        return h
    return likelihood.fit(actives, h.tolerances, 6, None, 1e-6, edges=edges)


def _deviations(likelihood: Likelihood, h: Hypothesis, edges: bool) -> list[list[float]]:
    """Return the standard deviations of each effect's fitted variables."""
    assert h.fit is not None
    every = h.fit.deviation()
    at = likelihood.nuisances
    out = []
    for active in h.actives:
        count = len(active.inner)
        out.append([float(x) for x in every[at : at + count]])
        at += count + (len(active.gate.variables()) if edges else 0)
    return out


def _effect(
    likelihood: Likelihood, active: Active, deviation: list[float], stands: Standing
) -> FoundEffect:
    parameters = {}
    for parameter, inner, one in zip(
        active.effect.parameters, active.inner, deviation, strict=True
    ):
        systematic = SYSTEMATIC * abs(inner - parameter.inner_neutral)
        if not parameter.inverse:
            systematic = float(np.hypot(systematic, 0.1 * parameter.least))
        half = QUANTILE * float(np.hypot(COLOURED * one, systematic))
        ends = sorted(parameter.value(max(x, 1e-12) if parameter.inverse else x)
                      for x in (inner - half, inner + half))
        parameters[parameter.name] = Interval(
            parameter.value(inner), ends[0], ends[1], parameter.unit
        )
    gate = active.gate
    return FoundEffect(
        active.effect, parameters, round(stands.confidence(), 3), stands.alternatives,
        gate.kind, gate.intervals(likelihood.course), stands.gain, stands.rivals,
        gate.stretches, gate.onset_s,
    )
