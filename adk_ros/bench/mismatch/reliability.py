# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reliability of stated confidences: how often claims with a confidence are right.

A claim is a named effect with its confidence; it is right if the effect, or an alternative that
the confidence includes, is in the label. Table and diagram compare the mean confidence of a bin
with the share that is right and its 95 % interval of Clopper and Pearson. The Brier score is the
mean squared difference of confidence and outcome (0 or 1): 0 is perfect, 0.25 that of always 0.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from scipy.stats import binomtest

from adk_ros.bench.paper.paper_tables import markdown_line
from adk_ros.files.pages.figure_style import BLUE, GREY

EDGES = (0.0, 0.5, 0.7, 0.9, 1.0)
"""Limits of the bins of confidence; a limit belongs to the bin above it."""
CONFIDENT = EDGES[-2]
"""Confidence from which on a claim counts as confident."""
_LEVEL = 0.95
TABLE_FILE, DIAGRAM_FILE = "reliability.md", "reliability.png"
_HEADER = ("confidence", "claims", "mean confidence", "right", "95 % interval")


class ScoredClaim(NamedTuple):
    """Reported effect with its alternatives, its confidence, and whether the label has it."""

    effect: str
    confidence: float
    right: bool


class Bin(NamedTuple):
    """Claims with a confidence within `low` to `high`: number, means, interval of the share."""

    low: float
    high: float
    claims: int
    said: float
    right: float
    interval: tuple[float, float]


def reliability_table(claims: Sequence[ScoredClaim]) -> list[Bin]:
    """Return the bins; means and interval of an empty one are NaN."""
    bins = []
    for low, high in pairwise(EDGES):
        inside = [
            c for c in claims if low <= c.confidence < high or high == c.confidence == EDGES[-1]
        ]
        if not inside:
            bins.append(Bin(low, high, 0, np.nan, np.nan, (np.nan, np.nan)))
            continue
        right = sum(c.right for c in inside)
        bins.append(
            Bin(
                low,
                high,
                len(inside),
                float(np.mean([c.confidence for c in inside])),
                right / len(inside),
                share_interval(right, len(inside)),
            )
        )
    return bins


def share_interval(right: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a share by Clopper and Pearson."""
    interval = binomtest(right, count).proportion_ci(_LEVEL, method="exact")
    return float(interval.low), float(interval.high)


def brier_score(claims: Sequence[ScoredClaim]) -> float:
    """Return the mean squared difference of confidence and outcome; NaN without claims."""
    if not claims:
        return float("nan")
    return float(np.mean([(c.confidence - c.right) ** 2 for c in claims]))


def reliability_markdown(claims: Sequence[ScoredClaim]) -> str:
    """Return the table of bins and the Brier score as Markdown."""
    lines = [markdown_line(_HEADER), markdown_line(["---"] * len(_HEADER))]
    for b in reliability_table(claims):
        figures = ["", "", ""]
        if b.claims:
            low, high = b.interval
            figures = [f"{b.said:.2f}", f"{b.right:.2f}", f"{low:.2f} to {high:.2f}"]
        lines.append(markdown_line([f"{b.low:g} to {b.high:g}", str(b.claims), *figures]))
    score = f"{brier_score(claims):.3f}" if claims else "no claim"
    return "\n".join([*lines, "", f"Brier score of {len(claims)} claims: {score}", ""])


def write_reliability(claims: Sequence[ScoredClaim], out: Path) -> None:
    """Write the table and the reliability diagram to the folder `out`."""
    (out / TABLE_FILE).write_text(reliability_markdown(claims), encoding="utf-8")
    bins = [b for b in reliability_table(claims) if b.claims]
    score = f", Brier score {brier_score(claims):.3f}" if claims else ""
    figure, axes = plt.subplots(figsize=(4.6, 4.4), constrained_layout=True)
    axes.plot([0.0, 1.0], [0.0, 1.0], "--", color=GREY, label="calibrated")
    if bins:
        right = np.array([b.right for b in bins])
        limits = np.array([b.interval for b in bins]).T
        errors = np.maximum([right - limits[0], limits[1] - right], 0.0)
        said = [b.said for b in bins]
        axes.errorbar(said, right, errors, fmt="o", color=BLUE, capsize=4, label="95 % interval")
        for b in bins:
            # Inside the axes: below and left of the point, unless that is at the lower limit.
            at = (-6, -14) if b.right > 0.1 else (-6, 6)
            axes.annotate(
                f"{b.claims}", (b.said, b.right), at, textcoords="offset points", ha="right"
            )
    axes.set(
        xlim=(0.0, 1.02), ylim=(0.0, 1.05), xlabel="mean confidence of the claims",
        ylabel="share that is right",
        title=f"{len(claims)} claims{score}",
    )  # fmt: skip
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    axes.grid(alpha=0.3)
    figure.savefig(out / DIAGRAM_FILE, dpi=150)
    plt.close(figure)
