# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Why a bar is not reached, in sentences made of the run's own figures.

Which cells do it, how large the errors are there beside the sensors' noise and the floor's, which
rival leads and where, and where it diverges. Nothing is said that the scores do not hold.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection

import numpy as np

from adk_ros.bench.paper import criteria
from adk_ros.bench.paper.av21 import JUDGED, RecordingScores
from adk_ros.bench.paper.cases import CLEAN, NOISY
from adk_ros.bench.paper.failed_combinations import (
    SHOWN,
    best_naive,
    cell_location,
    distribution,
    divergence,
    error_magnitudes,
    worst_cells,
)
from adk_ros.bench.paper.paper_results import printed
from adk_ros.bench.paper.paper_tables import number
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    ALDK,
    MF_TUNED,
    NAIVE,
    ORACLE,
    PYKOOP,
    PYKOOPMAN,
    SWLS,
)
from adk_ros.bench.paper.ratios import geometric_means
from adk_ros.bench.paper.scores import CHANNELS, HORIZONS, UNITS, Cell, ScoreTable
from adk_ros.signals.score import REPORT_SCALE


def explain_failures(
    board: ScoreTable,
    recorded: RecordingScores | None,
    judged: Collection[criteria.PaperCriterion],
) -> dict[str, str]:
    """Return a paragraph for each bar that failed, by its name; none for what was not run."""
    makers: dict[str, Callable[[], list[str]]] = {
        "geometric-mean": lambda: _mean(board),
        "no-cell-above-1": lambda: _above(board),
        "ahead-of-pykoop": lambda: _behind(board, PYKOOP),
        "ahead-of-pykoopman": lambda: _behind(board, PYKOOPMAN),
        "ahead-of-tuned-7dof": lambda: _behind(board, MF_TUNED),
        "coverage": lambda: _coverage(board),
        "av21": lambda: _recordings(recorded),
        "papers-effect": lambda: _effect(board),
    }
    return {
        bar.name: " ".join(makers[bar.name]())
        for bar in judged
        if bar.verdict == criteria.FAIL and not bar.figure.startswith("not measured")
    }


def _mean(board: ScoreTable) -> list[str]:
    said = []
    means = geometric_means(board, ADK_ROS)
    floor = geometric_means(board, ORACLE)
    for variant in board.variants():
        listed = ", ".join(f"{number(means[variant, i])} at {h}" for i, h in enumerate(HORIZONS))
        said.append(f"{variant.capitalize()}, the mean is {listed}.")
    if (NOISY, 0) in floor:
        listed = ", ".join(f"{number(floor[NOISY, i])} at {h}" for i, h in enumerate(HORIZONS))
        said.append(
            f"The noisy floor (the plant itself, started from the same sample) has {listed}."
        )
    ratios = {cell: float(np.log(r.mean())) for cell, r in board.ratios(ADK_ROS).items()}
    whole = float(np.exp(np.mean(list(ratios.values()))))
    by_test = {
        test: float(np.exp(np.mean([v for c, v in ratios.items() if c.test == test])))
        for test in board.tests()
    }
    by_channel = [
        np.exp(np.mean([v for cell, v in ratios.items() if cell.channel == c]))
        for c in range(len(CHANNELS))
    ]
    listed = ", ".join(f"{v:.3f} for {c}" for c, v in zip(CHANNELS, by_channel, strict=True))
    said.append(f"By channel it is {listed}.")
    worst = sorted(by_test, key=by_test.__getitem__, reverse=True)[:SHOWN]
    named = ", ".join(f"{test} ({by_test[test]:.3f})" for test in worst)
    rest = [v for c, v in ratios.items() if c.test not in worst]
    if rest:
        said.append(
            f"By test it is highest in {named}; over the other tests it is "
            f"{np.exp(np.mean(rest)):.3f} instead of {whole:.3f}."
        )
    return said


def _above(board: ScoreTable) -> list[str]:
    lost = criteria.cells_above_one(board)
    best = Counter(best_naive(board, cell) for cell in lost)
    who = ", ".join(f"{name} in {n}" for name, n in best.most_common())
    return [
        *cell_location(board, lost, "A naive predictor wins in"),
        f"The best naive predictor there is {who}.",
        *error_magnitudes(board, lost),
        worst_cells(board, {cell: float(r.mean()) for cell, r in lost.items()}),
    ]


def _behind(board: ScoreTable, rival: str) -> list[str]:
    behind = criteria.behind_of(board, rival)
    return [
        *cell_location(board, behind, f"{rival} leads in"),
        distribution(board, behind, rival),
        divergence(board, rival),
        *error_magnitudes(board, behind, rival),
        worst_cells(board, behind, rival),
    ]


def _coverage(board: ScoreTable) -> list[str]:
    low, high = criteria.COVERAGE
    said = []
    for cell, value in criteria.pooled_coverage(board).items():
        if low <= value <= high:
            continue
        i, c = cell.horizon, cell.channel
        by_test = {test: float(board.coverage(cell.variant, test)[i, c]) for test in board.tests()}
        least, most = (pick(by_test, key=by_test.__getitem__) for pick in (min, max))
        width = "narrow" if value < low else "wide"
        said.append(
            f"{cell.variant} {CHANNELS[c]} at {HORIZONS[i]}: the intervals are too {width}, "
            f"{100 * value:.1f} % are within; by test from {100 * by_test[least]:.1f} % "
            f"({least}) to {100 * by_test[most]:.1f} % ({most})."
        )
    return said


def _recordings(recorded: RecordingScores | None) -> list[str]:
    said = []
    for test, ratio in (recorded.pairs(own=True) if recorded else {}).items():
        by_name = recorded.rmse.get(test, {}) if recorded else {}
        for i in JUDGED:
            for c in range(3):
                if ratio[i, c] < 1.0 or not by_name:
                    continue
                naive = {n: float(by_name[n][i, c]) for n in NAIVE if n in by_name}
                best = min(naive, key=naive.__getitem__)
                ours = float(by_name[ADK_ROS][i, c] * REPORT_SCALE[c])
                said.append(
                    f"{test.split(' / ')[0]}, {CHANNELS[c]} at {HORIZONS[i]}: ours "
                    f"{number(ours)}, {best} {number(naive[best] * float(REPORT_SCALE[c]))} "
                    f"{UNITS[c]}; one step ahead our ratio is {ratio[0, c]:.2f}."
                )
    return said


def _effect(board: ScoreTable) -> list[str]:
    """Whether ALDK is better than the paper's, which leaves less to gain, or SWLS worse."""
    found = criteria.papers_effect(board)
    short = [cell for cell, (here, there) in found.items() if not here >= there]

    def against(name: str) -> dict[Cell, float]:
        """Ours over the paper's RMSE."""
        return {
            cell: float(
                board.rmse(CLEAN, cell.test, name)[0, cell.channel]
                * REPORT_SCALE[cell.channel] / printed(cell.test, name)[cell.channel]
            )
            for cell in short
        }  # fmt: skip

    aldk, swls = against(ALDK), against(SWLS)
    better = [cell for cell in short if aldk[cell] < 1.0]
    worse = [cell for cell in short if swls[cell] > 1.0]
    missing = [100.0 * (found[cell][1] - found[cell][0]) for cell in short]
    return [
        f"In {len(better)} of the {len(short)} cells {ALDK} without adaptation is more accurate "
        f"here than in the paper ({number(float(np.median(list(aldk.values()))))} times its RMSE "
        f"in the median), which leaves adaptation less to gain. {SWLS} has "
        f"{number(float(np.median(list(swls.values()))))} times the paper's RMSE in the median, "
        f"and is less accurate than the paper's in {len(worse)}.",
        f"What is missing is {min(missing):.1f} to {max(missing):.1f} percentage points. The car "
        f"and the roads are not the paper's.",
    ]
