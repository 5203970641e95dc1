# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How a claim of the paper is judged: as comparisons of our own figures, each true or not.

A claim holds if all its comparisons are true, does not hold if none is, and holds in part
otherwise. The comparisons are in `claims_list`; all are of the clean variant, one step ahead,
since the paper has no noise and no horizon. Figures are in km/h, km/h, deg/s.
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
    "Each claim is broken into comparisons of our own figures (one step ahead, clean, Max and "
    "RMSE in km/h, km/h, deg/s), shown with it. It holds if all of them are true, does not hold "
    "if none is, and holds in part otherwise. Where the paper gives a percentage, ours has to be "
    "as large; where its tables give less than its text, as large as by its tables."
)

Series = Callable[[str, str], tuple[FloatArray, ...]]
"""(test, predictor) -> time (n,) s, truth (n, 3), one-step prediction (n, 3), SI."""


@dataclass(frozen=True)
class Comparison:
    """What was compared, with both figures, and whether it came out as the paper says."""

    text: str
    true: bool


@dataclass(frozen=True)
class Claim:
    """
    A claim: `section` of the paper, its `text`, and the comparisons that it rests on.

    None of these where a test or predictor was not run.
    """

    section: str
    text: str
    comparisons: tuple[Comparison, ...]

    @property
    def verdict(self) -> str:
        """One of `HOLDS`, `PART`, `NOT`, `UNKNOWN`."""
        if not self.comparisons:
            return UNKNOWN
        true = sum(item.true for item in self.comparisons)
        return HOLDS if true == len(self.comparisons) else PART if true else NOT


def counts(claims: Sequence[Claim]) -> str:
    """How many claims there are of each verdict, in words."""
    found = Counter(claim.verdict for claim in claims)
    listed = ", ".join(f"{found[v]} {v}" for v in (HOLDS, PART, NOT, UNKNOWN) if found[v])
    return f"Of {len(claims)} claims: {listed}."


@dataclass(frozen=True)
class ClaimEvidence:
    """Our figures, as the comparisons ask for them; KeyError for what was not run."""

    board: ScoreTable
    series: Series

    def rmse(self, test: str, name: str) -> FloatArray:
        """One step ahead, clean, (3,)."""
        return np.asarray(self.board.rmse(CLEAN, test, name)[0] * REPORT_SCALE)

    def worst(self, test: str, name: str) -> FloatArray:
        """Likewise the largest error."""
        return np.asarray(self.board.worst(CLEAN, test, name)[0] * REPORT_SCALE)

    def errors(self, test: str, name: str) -> tuple[FloatArray, FloatArray]:
        """Time (n,) s from the test's start, and predicted less true (n, 3)."""
        time_s, truth, predicted = self.series(test, name)
        return time_s, np.asarray((predicted - truth) * REPORT_SCALE)

    def spread(self, test: str, name: str) -> FloatArray:
        """Deviation (3,) of the truth itself."""
        return np.asarray(self.series(test, name)[1].std(axis=0) * REPORT_SCALE)

    def tick_us(self, test: str, name: str) -> float:
        """Microseconds that a tick of the pass took, roll-outs included."""
        item = self.board.seeds(CLEAN, test, name)[0]
        return float(1e6 * item.seconds / max(int(item.count[0]), 1))


Make = Callable[[ClaimEvidence], Sequence[Comparison]]


@dataclass(frozen=True)
class Statement:
    """A claim that has not been judged yet."""

    section: str
    text: str
    make: Make

    def check(self, evidence: ClaimEvidence) -> Claim:
        """Compare, as far as there is something to compare."""
        try:
            return Claim(self.section, self.text, tuple(self.make(evidence)))
        except KeyError:
            return Claim(self.section, self.text, ())


def less(
    what: str, value: float, than: str, limit: float, quoted: tuple[float, float] | None = None
) -> Comparison:
    """`value` is below `limit`; `quoted`: the same two in the paper."""
    text = f"{what} {number(value)} < {than} {number(limit)}"
    if quoted is not None:
        text += f" (paper {quoted[0]:g}, {quoted[1]:g})"
    return Comparison(text, value < limit)


def by_channel(
    evidence: ClaimEvidence,
    test: str,
    name: str,
    rival: str,
    what: str = "rmse",
    channels: Sequence[int] = (0, 1, 2),
) -> list[Comparison]:
    """`name`'s RMSE or Max is below `rival`'s on each channel."""
    ours, theirs = (getattr(evidence, "rmse" if what == "rmse" else "worst")(test, who)
                    for who in (name, rival))  # fmt: skip
    label = "RMSE" if what == "rmse" else "Max"
    return [
        less(
            f"{test}, {CHANNELS[c]}: {label} of {name}", float(ours[c]), rival, float(theirs[c]),
            _quoted(test, name, rival, what, c),
        )
        for c in channels
    ]  # fmt: skip


def _quoted(
    test: str, name: str, rival: str, what: str, channel: int
) -> tuple[float, float] | None:
    try:
        pair = [float(printed(test, who, what)[channel]) for who in (name, rival)]
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
    """Whether `name` has the lowest RMSE or Max of `among`, or the highest, by channel."""
    figures = {
        who: getattr(evidence, "rmse" if what == "rmse" else "worst")(test, who) for who in among
    }
    label = "RMSE" if what == "rmse" else "Max"
    result = []
    for c in channels:
        others = {who: float(v[c]) for who, v in figures.items() if who != name}
        rival = (max if highest else min)(others, key=others.__getitem__)
        own = float(figures[name][c])
        true = own > others[rival] if highest else own < others[rival]
        sign = ">" if highest else "<"
        result.append(Comparison(
            f"{test}, {CHANNELS[c]}: {label} of {name} {number(own)} {sign} the next, {rival} "
            f"{number(others[rival])}", true,
        ))  # fmt: skip
    return result


def reduced(
    evidence: ClaimEvidence,
    test: str,
    name: str,
    rival: str,
    shares: Sequence[float],
    what: str = "rmse",
    channels: Sequence[int] = (0, 1, 2),
) -> list[Comparison]:
    """`name`'s figure is below `rival`'s by at least `shares`, in per cent, as in the paper."""
    pick = evidence.rmse if what == "rmse" else evidence.worst
    ours, theirs = pick(test, name), pick(test, rival)
    label = "RMSE" if what == "rmse" else "Max"
    result = []
    for c, share in zip(channels, shares, strict=True):
        gain = 100.0 * (1.0 - float(ours[c] / theirs[c]))
        change = f"{abs(gain):.1f} % {'less' if gain > 0 else 'more'}"
        result.append(Comparison(
            f"{test}, {CHANNELS[c]}: {label} {number(float(theirs[c]))} of {rival} to "
            f"{number(float(ours[c]))} of {name}, {change} (paper {share:g} % less)",
            gain >= share,
        ))  # fmt: skip
    return result
