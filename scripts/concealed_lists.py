# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the results of all lists of `adk bench concealed --own` in a folder, and their sums.

    python scripts/concealed_lists.py [doc/concealed/lists]

A file `seed_S_COMMIT.txt` is the `criteria.txt` that the list of seed S gave at that commit.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

LISTS = Path(__file__).parents[1] / "doc" / "concealed" / "lists"
CRITERIA = {
    "singles-strength-1": ("single effects at strength 1", "0.97"),
    "singles-strength-0.3": ("single effects at strength 0.3", "0.95"),
    "singles-strength-0.1": ("at 0.1, of a detectable size", "0.7"),
    "pairs-set-f1": ("pairs, F1", "0.95"),
    "triples-set-f1": ("triples, F1", "0.88"),
    "unlisted-unknown": ("unlisted effects and dropouts", "0.9"),
    "other-family-simulators": ("simulators of another family", "0.95"),
    "multi-body-singles": ("multi-body model", "0.9"),
    "confident-claims-right": ("claims with a confidence of at least 0.9", "0.95"),
    "false-alarms": ("false alarms", "none"),
}
COUNTED = "false-alarms"
WRONG_SINCE = {(11, "confident-claims-right"): 1}
"""Claims that were counted as right and are counted as wrong since f2b113c: (seed, criterion)."""


@dataclass(frozen=True)
class Figure:
    """A mean, or a number of cases where the criterion counts them, over `cases`."""

    value: float
    cases: int


def figures_of(text: str, seed: int) -> dict[str, Figure]:
    """Return the figures of one list by criterion."""
    figures = {}
    for line in text.splitlines():
        found = re.match(r"(?:PASS|FAIL) (\S+) ([\d.]+) of (\d+) ", line)
        if found is None or found[1] not in CRITERIA:
            continue
        name, value, cases = found[1], float(found[2]), int(found[3])
        figures[name] = Figure(value - WRONG_SINCE.get((seed, name), 0) / cases, cases)
    return figures


def _together(name: str, figures: Sequence[Figure]) -> str:
    cases = sum(x.cases for x in figures)
    if name == COUNTED:
        return f"{sum(x.value for x in figures):.0f} of {cases}"
    return f"{sum(x.value * x.cases for x in figures) / cases:.3f} of {cases}"


def table(folder: Path) -> list[str]:
    """Return the lines of the table, a column per list; for false alarms their number."""
    lists = {}
    for path in folder.glob("seed_*_*.txt"):
        seed = int(path.stem.split("_")[1])
        lists[seed] = figures_of(path.read_text(encoding="utf-8"), seed)
    seeds = sorted(lists)
    lines = [
        "| criterion | " + " | ".join(f"seed {x}" for x in seeds) + " | together | target |",
        "| --- |" + " --- |" * (len(seeds) + 2),
    ]
    for name, (words, target) in CRITERIA.items():
        figures = [lists[seed][name] for seed in seeds]
        places = 0 if name == COUNTED else 3
        cells = [f"{x.value:.{places}f}" for x in figures]
        lines.append(f"| {words} | {' | '.join(cells)} | {_together(name, figures)} | {target} |")
    return lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=LISTS)
    print("\n".join(table(parser.parse_args().folder)))


if __name__ == "__main__":
    main()
