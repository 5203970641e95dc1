# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Explain failed acceptance criteria in sentences computed from the scores.

They say in which combinations a criterion fails, how large the errors are compared with sensor
noise and oracle, which baseline leads where, and where it diverges.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection

import numpy as np

from adk_ros.bench.paper import criteria
from adk_ros.bench.paper.av21 import JUDGED, RecordingScores
from adk_ros.bench.paper.cases import CLEAN, NOISY
from adk_ros.bench.paper.criterion import FAIL, Criterion
from adk_ros.bench.paper.failed_combinations import (
    SHOWN,
    best_naive,
    combination_location,
    distribution,
    divergence,
    error_magnitudes,
    worst_combinations,
)
from adk_ros.bench.paper.interval_criteria import COVERAGE
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
from adk_ros.bench.paper.scores import CHANNELS, HORIZONS, UNITS, Combination, ScoreTable
from adk_ros.signals.score import REPORT_SCALE


def explain_failures(
    board: ScoreTable,
    recorded: RecordingScores | None,
    judged: Collection[Criterion],
) -> dict[str, str]:
    """Return a paragraph for each failed criterion, by name; none for what was not measured."""
    makers: dict[str, Callable[[], list[str]]] = {
        "geometric-mean": lambda: _mean(board),
        "no-combination-above-1": lambda: _lost(board),
        "ahead-of-pykoop": lambda: _behind(board, PYKOOP),
        "ahead-of-pykoopman": lambda: _behind(board, PYKOOPMAN),
        "ahead-of-tuned-7dof": lambda: _behind(board, MF_TUNED),
        "coverage": lambda: _coverage(board),
        "av21": lambda: _recordings(recorded),
        "papers-effect": lambda: _effect(board),
    }
    return {
        criterion.name: " ".join(makers[criterion.name]())
        for criterion in judged
        if criterion.verdict == FAIL and not criterion.figure.startswith("not measured")
    }


def _mean(board: ScoreTable) -> list[str]:
    sentences = []
    means = geometric_means(board, ADK_ROS)
    oracle = geometric_means(board, ORACLE)
    for variant in board.variants():
        listed = ", ".join(f"{number(means[variant, i])} at {h}" for i, h in enumerate(HORIZONS))
        sentences.append(f"{variant.capitalize()}, the mean is {listed}.")
    if (NOISY, 0) in oracle:
        listed = ", ".join(f"{number(oracle[NOISY, i])} at {h}" for i, h in enumerate(HORIZONS))
        sentences.append(
            f"Noisy, that of the oracle (the plant itself, started from the same sample) is "
            f"{listed}."
        )
    ratios = {combo: float(np.log(r.mean())) for combo, r in board.ratios(ADK_ROS).items()}
    whole = float(np.exp(np.mean(list(ratios.values()))))
    by_test = {
        test: float(np.exp(np.mean([v for c, v in ratios.items() if c.test == test])))
        for test in board.tests()
    }
    by_channel = [
        np.exp(np.mean([v for combo, v in ratios.items() if combo.channel == c]))
        for c in range(len(CHANNELS))
    ]
    listed = ", ".join(f"{v:.3f} for {c}" for c, v in zip(CHANNELS, by_channel, strict=True))
    sentences.append(f"By channel it is {listed}.")
    worst = sorted(by_test, key=by_test.__getitem__, reverse=True)[:SHOWN]
    named = ", ".join(f"{test} ({by_test[test]:.3f})" for test in worst)
    rest = [v for c, v in ratios.items() if c.test not in worst]
    if rest:
        sentences.append(
            f"By test it is highest in {named}; over the other tests it is "
            f"{np.exp(np.mean(rest)):.3f} instead of {whole:.3f}."
        )
    return sentences


def _lost(board: ScoreTable) -> list[str]:
    lost = criteria.lost_combinations(board)
    best = Counter(best_naive(board, combo) for combo in lost)
    who = ", ".join(f"{name} in {n}" for name, n in best.most_common())
    return [
        *combination_location(board, lost, "A naive predictor wins in"),
        f"The best naive predictor there is {who}.",
        *error_magnitudes(board, lost),
        worst_combinations(board, {combo: float(r.mean()) for combo, r in lost.items()}),
    ]


def _behind(board: ScoreTable, baseline: str) -> list[str]:
    behind = criteria.behind_of(board, baseline)
    return [
        *combination_location(board, behind, f"{baseline} leads in"),
        distribution(board, behind, baseline),
        divergence(board, baseline),
        *error_magnitudes(board, behind, baseline),
        worst_combinations(board, behind, baseline),
    ]


def _coverage(board: ScoreTable) -> list[str]:
    low, high = COVERAGE
    sentences = []
    for combo, value in criteria.pooled_coverage(board).items():
        if low <= value <= high:
            continue
        i, c = combo.horizon, combo.channel
        by_test = {
            test: float(board.coverage(combo.variant, test)[i, c]) for test in board.tests()
        }
        least, most = (pick(by_test, key=by_test.__getitem__) for pick in (min, max))
        width = "narrow" if value < low else "wide"
        sentences.append(
            f"{combo.variant} {CHANNELS[c]} at {HORIZONS[i]}: the intervals are too {width}, "
            f"coverage {100 * value:.1f} %; by test from {100 * by_test[least]:.1f} % "
            f"({least}) to {100 * by_test[most]:.1f} % ({most})."
        )
    return sentences


def _recordings(recorded: RecordingScores | None) -> list[str]:
    sentences = []
    for test, ratio in (recorded.pairs(same=True) if recorded else {}).items():
        by_name = recorded.rmse.get(test, {}) if recorded else {}
        for i in JUDGED:
            for c in range(3):
                if ratio[i, c] < 1.0 or not by_name:
                    continue
                naive = {n: float(by_name[n][i, c]) for n in NAIVE if n in by_name}
                best = min(naive, key=naive.__getitem__)
                rmse = float(by_name[ADK_ROS][i, c] * REPORT_SCALE[c])
                sentences.append(
                    f"{test.split(' / ')[0]}, {CHANNELS[c]} at {HORIZONS[i]}: {ADK_ROS} "
                    f"{number(rmse)}, {best} {number(naive[best] * float(REPORT_SCALE[c]))} "
                    f"{UNITS[c]}; one step ahead the ratio is {ratio[0, c]:.2f}."
                )
    return sentences


def _effect(board: ScoreTable) -> list[str]:
    """Say whether ALDK is better than in the paper, which leaves less to gain, or SWLS worse."""
    found = criteria.papers_effect(board)
    short = [combo for combo, (here, there) in found.items() if not here >= there]

    def against(name: str) -> dict[Combination, float]:
        """Return the RMSE here over the one in the paper."""
        return {
            combo: float(
                board.rmse(CLEAN, combo.test, name)[0, combo.channel]
                * REPORT_SCALE[combo.channel] / printed(combo.test, name)[combo.channel]
            )
            for combo in short
        }  # fmt: skip

    aldk, swls = against(ALDK), against(SWLS)
    better = [combo for combo in short if aldk[combo] < 1.0]
    worse = [combo for combo in short if swls[combo] > 1.0]
    missing = [100.0 * (found[combo][1] - found[combo][0]) for combo in short]
    return [
        f"In {len(better)} of the {len(short)} entries {ALDK} without adaptation is more accurate "
        f"here than in the paper ({number(float(np.median(list(aldk.values()))))} times its RMSE "
        f"in the median), which leaves adaptation less to gain. {SWLS} has "
        f"{number(float(np.median(list(swls.values()))))} times the paper's RMSE in the median, "
        f"and is less accurate than in the paper in {len(worse)}.",
        f"The difference is {min(missing):.1f} to {max(missing):.1f} percentage points. Vehicle "
        f"and roads differ from those of the paper.",
    ]
