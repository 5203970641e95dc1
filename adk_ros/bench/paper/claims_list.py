# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The claims of sections 4.2 to 5 of the paper, each with the comparisons that decide it."""

from __future__ import annotations

import numpy as np

from adk_ros.bench.paper import comparisons as c
from adk_ros.bench.paper.cases import CLEAN, NOMINAL
from adk_ros.bench.paper.claims import (
    Claim,
    ClaimEvidence,
    Series,
    Statement,
    by_channel,
    lowest,
    reduced,
)
from adk_ros.bench.paper.paper_results import FIVE
from adk_ros.bench.paper.paper_tables import number
from adk_ros.bench.paper.predictors import ALDK, DK, FFRLS, MF, SWLS
from adk_ros.bench.paper.scores import ScoreTable

STATEMENTS = (
    Statement("4.2.1", "ALDK and DK both show the overall trend of the benchmark.", c.trend),
    Statement(
        "4.2.1", "Compared to DK, ALDK's largest yaw rate error decreases (4.844 to 1.157 "
        "deg/s) and "
        "its RMSE by 87 % (82 % by its Table 3).", c.dk_yaw,
    ),
    Statement(
        "4.2.1", "ALDK's Max and RMSE of v_x are below DK's.",
        lambda e: [*by_channel(e, NOMINAL, ALDK, DK, "max", (0,)),
                   *by_channel(e, NOMINAL, ALDK, DK, "rmse", (0,))],
    ),
    Statement(
        "4.2.1", "The RMSE of v_y is lowered by 89 % (84 % by its Table 3).",
        lambda e: reduced(e, NOMINAL, ALDK, DK, (84.0,), channels=(1,)),
    ),
    Statement(
        "4.2.1", "The acceleration loss makes the deep Koopman model more accurate.",
        lambda e: by_channel(e, NOMINAL, ALDK, DK),
    ),
    Statement(
        "4.2.2", "ALDK-RLS is no notable improvement over ALDK.",
        lambda e: c.rls_same(e, NOMINAL),
    ),
    Statement(
        "4.2.2", "ALDK-FFRLS and ALDK-SWLS both improve on ALDK.",
        lambda e: [*by_channel(e, NOMINAL, FFRLS, ALDK), *by_channel(e, NOMINAL, SWLS, ALDK)],
    ),
    Statement(
        "4.2.2", "7 DoF-MF is satisfactory for v_x, and the worst of the five for v_y and yaw "
        "rate.", c.mf_nominal,
    ),
    Statement(
        "4.2.2", "ALDK-SWLS's RMSE is below ALDK's by 95, 91 and 91 %.",
        lambda e: reduced(e, NOMINAL, SWLS, ALDK, (95.0, 91.0, 91.0)),
    ),
    Statement(
        "4.2.2", "ALDK-RLS's largest error decreases for yaw rate and gets worse for v_x and v_y.",
        c.rls_max,
    ),
    Statement(
        "4.2.2", "ALDK-FFRLS has the largest maximum errors.",
        lambda e: lowest(e, NOMINAL, FFRLS, FIVE, "max", highest=True),
    ),
    Statement(
        "4.2.2", "ALDK-SWLS has the smallest maximum errors.",
        lambda e: lowest(e, NOMINAL, SWLS, FIVE, "max"),
    ),
    Statement(
        "4.2.2", "ALDK-RLS and ALDK-FFRLS oscillate noticeably between 50 and 100 s.",
        c.oscillation,
    ),
    Statement("4.2.2", "The recursion of SWLS is computationally efficient.", c.efficient),
    Statement(
        "4.3.1", "+160 kg: ALDK and ALDK-RLS have similar errors.",
        lambda e: c.rls_same(e, c.MASS_UP),
    ),
    Statement(
        "4.3.1", "+160 kg: ALDK-FFRLS's RMSE is 38, 37 and 49 % below ALDK's.",
        lambda e: reduced(e, c.MASS_UP, FFRLS, ALDK, (38.0, 37.0, 49.0)),
    ),
    Statement(
        "4.3.1", "+160 kg: ALDK-SWLS stands out; the largest error (0.067 km/h, Table 5: of v_y) "
        "is below that of ALDK and of 7 DoF-MF.", c.mass_up,
    ),
    Statement(
        "4.3.1", "-170 kg: ALDK-SWLS still has the higher accuracy.",
        lambda e: lowest(e, c.MASS_DOWN, SWLS, c.DATA_DRIVEN),
    ),
    Statement(
        "4.3.2", "+142 kg·m²: ALDK-SWLS is a significant improvement on the other approaches.",
        lambda e: lowest(e, c.INERTIA_UP, SWLS, FIVE),
    ),
    Statement(
        "4.3.2", "+142 kg·m²: compared to 7 DoF-MF, ALDK-SWLS's largest error of v_x decreases, "
        "that of yaw rate by 63 %.", c.inertia_against_mf,
    ),
    Statement(
        "4.3.2", "+142 kg·m²: ALDK-SWLS's largest errors all come at the initial moment.",
        c.worst_first,
    ),
    Statement(
        "4.3.2", "+142 kg·m²: ALDK's RMSE of 0.835 km/h, 0.082 km/h and 1.086 deg/s becomes "
        "0.035, 0.004 and 0.055.",
        lambda e: reduced(e, c.INERTIA_UP, SWLS, ALDK, c.table_shares(c.INERTIA_UP).tolist()),
    ),
    Statement(
        "4.3.2", "-158 kg·m²: the results are the same.",
        lambda e: lowest(e, c.INERTIA_DOWN, SWLS, FIVE),
    ),
    Statement(
        "4.3.2", "A physics model is only as good as its vehicle parameters.", c.mf_depends
    ),
    Statement(
        "4.3.2", "ALDK-SWLS is robust to changes of sprung mass and yaw inertia.", c.robust
    ),
    Statement(
        "4.4.1", "Mountain: ALDK, ALDK-RLS and ALDK-FFRLS show significant errors, above all in "
        "v_x.", lambda e: c.far_off(e, c.MOUNTAIN),
    ),
    Statement(
        "4.4.1", "Mountain: 7 DoF-MF's yaw rate is far off.",
        lambda e: lowest(e, c.MOUNTAIN, MF, FIVE, channels=(2,), highest=True),
    ),
    Statement(
        "4.4.1", "Mountain: ALDK-SWLS captures the instant dynamics well.",
        lambda e: lowest(e, c.MOUNTAIN, SWLS, FIVE),
    ),
    Statement(
        "4.4.2", "Slalom: large errors of v_x for ALDK, ALDK-RLS and ALDK-FFRLS.",
        lambda e: c.far_off(e, c.SLALOM),
    ),
    Statement(
        "4.4.2", "Slalom: the fast steering from 15 to 50 s disturbs the data-driven methods, the "
        "slow rest does not.", c.fast_and_slow,
    ),
    Statement(
        "4.4.2", "Slalom: 7 DoF-MF is more accurate than ALDK-SWLS for v_x, less for v_y and yaw "
        "rate.", c.slalom_mf,
    ),
    Statement(
        "4.4.2", "Slalom: ALDK-SWLS is a performant and reliable method.",
        lambda e: lowest(e, c.SLALOM, SWLS, c.DATA_DRIVEN),
    ),
    Statement("4.4, 5", "ALDK-SWLS has the best overall performance.", c.best_overall),
    Statement(
        "4.4, 5", "The acceleration loss improves generalisation: ALDK is better than DK in the "
        "tests with another vehicle, road or manoeuvre (the paper shows no DK there).",
        lambda e: c.throughout(c.OTHERS, ALDK, DK, e),
    ),
    Statement(
        "5", "SWLS copes with changes of vehicle, road and manoeuvre.",
        lambda e: c.throughout(c.OTHERS, SWLS, ALDK, e),
    ),
)  # fmt: skip


def check_claims(board: ScoreTable, series: Series) -> list[Claim]:
    """Check all claims against the measured scores."""
    evidence = ClaimEvidence(board, series)
    return [statement.check(evidence) for statement in STATEMENTS]


def compared_with(board: ScoreTable) -> list[str]:
    """Compare the paper's methods with naive predictors, also for longer horizons (sentences)."""
    result = []
    for name in (ALDK, SWLS):
        ratios = {
            combination: float(ratio.mean())
            for combination, ratio in board.ratios(name).items() if combination.variant == CLEAN
        }  # fmt: skip
        one_step = [ratio for combination, ratio in ratios.items() if combination.horizon == 0]
        longer = [ratio for combination, ratio in ratios.items() if combination.horizon > 0]
        if not one_step:
            continue
        result.append(
            f"{name}, clean: one step ahead its RMSE is below the best naive predictor's in "
            f"{sum(r < 1.0 for r in one_step)} of {len(one_step)} combinations (median ratio "
            f"{number(float(np.median(one_step)))}); from 0.25 to 2 s in "
            f"{sum(r < 1.0 for r in longer)} of {len(longer)} (median ratio "
            f"{number(float(np.median(longer)))})."
        )
    return result
