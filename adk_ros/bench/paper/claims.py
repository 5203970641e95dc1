# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Check claims of the paper by comparisons of measured figures, each of which agrees or not.

A claim holds if all its comparisons agree, does not hold if none does, and holds in part
otherwise. The comparisons are in `claims_list`; all use the clean variant, one step ahead, since
the paper has neither noise nor longer horizons. Figures are in km/h, km/h, deg/s.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.bench.paper.cases import CLEAN
from adk_ros.bench.paper.paper_results import printed
from adk_ros.bench.paper.paper_tables import number
from adk_ros.bench.paper.scores import CHANNELS, ScoreTable
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.score import REPORT_SCALE

HOLDS, PART, NOT, UNKNOWN = "holds", "holds in part", "does not hold", "not measured"
RULE = (
    "Each claim is split into comparisons of figures of this run (one step ahead, clean, Max and "
    "RMSE in km/h, km/h, deg/s), shown with it. It holds if all of them agree with the paper, "
    "does not hold if none does, and holds in part otherwise. Where the paper gives a percentage, "
    "this run must reach it; where its tables give less than its text, the value of the tables."
)

Series = Callable[[str, str], tuple[FloatArray, ...]]
"""(test, predictor) -> time (n,) s, truth (n, 3), one-step prediction (n, 3), SI."""


@dataclass(frozen=True)
class Comparison:
    """A comparison as measured, with both figures, and whether it agrees with the paper."""

    text: str
    agrees: bool

    @property
    def outcome(self) -> str:
        """The outcome in one word."""
        return "agrees" if self.agrees else "differs"


@dataclass(frozen=True)
class Claim:
    """
    A claim: `section` of the paper, its `text`, and the comparisons that decide it.

    There are no comparisons if a test or predictor was not run.
    """

    section: str
    text: str
    comparisons: tuple[Comparison, ...]

    @property
    def verdict(self) -> str:
        """One of `HOLDS`, `PART`, `NOT`, `UNKNOWN`."""
        if not self.comparisons:
            return UNKNOWN
        agreeing = sum(item.agrees for item in self.comparisons)
        return HOLDS if agreeing == len(self.comparisons) else PART if agreeing else NOT


def counts(claims: Sequence[Claim]) -> str:
    """Return a sentence with the number of claims by verdict."""
    found = Counter(claim.verdict for claim in claims)
    listed = ", ".join(f"{found[v]} {v}" for v in (HOLDS, PART, NOT, UNKNOWN) if found[v])
    return f"Of {len(claims)} claims: {listed}."


@dataclass(frozen=True)
class ClaimEvidence:
    """Measured figures for the comparisons; `KeyError` for a test or predictor not run."""

    board: ScoreTable
    series: Series

    def rmse(self, test: str, name: str) -> FloatArray:
        """Return the RMSE one step ahead, clean, (3,)."""
        return np.asarray(self.board.rmse(CLEAN, test, name)[0] * REPORT_SCALE)

    def worst(self, test: str, name: str) -> FloatArray:
        """Return the largest error one step ahead, clean, (3,)."""
        return np.asarray(self.board.worst(CLEAN, test, name)[0] * REPORT_SCALE)

    def errors(self, test: str, name: str) -> tuple[FloatArray, FloatArray]:
        """Return time (n,) s from the start of the test and the errors (n, 3)."""
        time_s, truth, predicted = self.series(test, name)
        return time_s, np.asarray((predicted - truth) * REPORT_SCALE)

    def spread(self, test: str, name: str) -> FloatArray:
        """Return the standard deviation (3,) of the truth."""
        return np.asarray(self.series(test, name)[1].std(axis=0) * REPORT_SCALE)

    def tick_us(self, test: str, name: str) -> float:
        """Return the time per tick including rollouts, µs."""
        item = self.board.seeds(CLEAN, test, name)[0]
        return float(1e6 * item.seconds / max(int(item.count[0]), 1))


Make = Callable[[ClaimEvidence], Sequence[Comparison]]


@dataclass(frozen=True)
class Statement:
    """A claim before its check; `make` returns its comparisons."""

    section: str
    text: str
    make: Make

    def check(self, evidence: ClaimEvidence) -> Claim:
        """Return the claim with its comparisons, if all figures were measured."""
        try:
            return Claim(self.section, self.text, tuple(self.make(evidence)))
        except KeyError:
            return Claim(self.section, self.text, ())


def less(
    what: str,
    value: float,
    than: str,
    limit: float,
    quoted: tuple[float, float] | None = None,
    unit: str = "",
) -> Comparison:
    """Compare: `value` is below `limit`, as in the paper; `quoted`: both values in the paper."""
    figures = [f"{number(each)} {unit}".rstrip() for each in (value, limit)]
    text = f"{what} {figures[0]} {relation(value, limit)} {than} {figures[1]}"
    if quoted is not None:
        text += f" (paper {quoted[0]:g}, {quoted[1]:g})"
    return Comparison(text, value < limit)


def relation(value: float, limit: float) -> str:
    """Return the measured relation of two figures as a sign."""
    return "<" if value < limit else ">" if value > limit else "="


def by_channel(
    evidence: ClaimEvidence,
    test: str,
    name: str,
    baseline: str,
    what: str = "rmse",
    channels: Sequence[int] = (0, 1, 2),
) -> list[Comparison]:
    """Compare: RMSE or Max of `name` is below that of `baseline` on each channel."""
    values, limits = (getattr(evidence, "rmse" if what == "rmse" else "worst")(test, who)
                      for who in (name, baseline))  # fmt: skip
    label = "RMSE" if what == "rmse" else "Max"
    return [
        less(
            f"{test}, {CHANNELS[c]}: {label} of {name}", float(values[c]), baseline,
            float(limits[c]), _quoted(test, name, baseline, what, c),
        )
        for c in channels
    ]  # fmt: skip


def _quoted(
    test: str, name: str, baseline: str, what: str, channel: int
) -> tuple[float, float] | None:
    try:
        pair = [float(printed(test, who, what)[channel]) for who in (name, baseline)]
    except KeyError:
        return None
    return pair[0], pair[1]


def lowest(
    evidence: ClaimEvidence,
    test: str,
    name: str,
    among: Sequence[str],
    what: str = "rmse",
    channels: Sequence[int] = (0, 1, 2),
    highest: bool = False,
) -> list[Comparison]:
    """Compare: `name` has the lowest (or highest) RMSE or Max of `among`, by channel."""
    figures = {
        who: getattr(evidence, "rmse" if what == "rmse" else "worst")(test, who) for who in among
    }
    label = "RMSE" if what == "rmse" else "Max"
    result = []
    for c in channels:
        others = {who: float(v[c]) for who, v in figures.items() if who != name}
        following = (max if highest else min)(others, key=others.__getitem__)
        value = float(figures[name][c])
        agrees = value > others[following] if highest else value < others[following]
        sign = relation(value, others[following])
        which = "the highest" if highest else "the lowest"
        result.append(Comparison(
            f"{test}, {CHANNELS[c]}: {label} of {name} {number(value)} {sign} {which} of "
            f"the others, {following} {number(others[following])}", agrees,
        ))  # fmt: skip
    return result


def reduced(
    evidence: ClaimEvidence,
    test: str,
    name: str,
    baseline: str,
    shares: Sequence[float],
    what: str = "rmse",
    channels: Sequence[int] = (0, 1, 2),
) -> list[Comparison]:
    """Compare: `name` is below `baseline` by at least `shares` (per cent, as in the paper)."""
    pick = evidence.rmse if what == "rmse" else evidence.worst
    values, limits = pick(test, name), pick(test, baseline)
    label = "RMSE" if what == "rmse" else "Max"
    result = []
    for c, share in zip(channels, shares, strict=True):
        gain = 100.0 * (1.0 - float(values[c] / limits[c]))
        change = f"{abs(gain):.1f} % {'less' if gain > 0 else 'more'}"
        result.append(Comparison(
            f"{test}, {CHANNELS[c]}: {label} {number(float(limits[c]))} of {baseline} to "
            f"{number(float(values[c]))} of {name}, {change} (paper {share:g} % less)",
            gain >= share,
        ))  # fmt: skip
    return result
