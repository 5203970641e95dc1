# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Generated cases that no benchmark contains, to calibrate criteria and confidence on."""

from __future__ import annotations

import numpy as np

from adk_ros.bench.mismatch.case_generator import InjectedMismatch
from adk_ros.bench.mismatch.case_matrix import (
    NEED_GRIP,
    NOISES,
    ROAD_STYLE_SEQUENCE,
    CasePlan,
    injected_mismatch,
)
from adk_ros.bench.vehicles.multibody import MULTI_BODY
from adk_ros.bench.vehicles.multibody_changes import EFFECTS as MULTIBODY_EFFECTS
from adk_ros.bench.vehicles.multibody_changes import SIZES as MULTIBODY_SIZES
from adk_ros.plant.injection.injected_drive import PLANTS
from adk_ros.plant.injection.injectors import FULL, SPRUNG_CAR_ONLY, UNLISTED, scale_strength

FIRST_SEED = 500_000
"""Seed of the first case: those of the benchmark begin at 1000."""
KINDS = ("clean", "single", "unlisted", "single", "clean", "pair", "single", "unlisted")
"""
Kinds of cases in turn. Much that is not listed, since it is what a wrong name stands for; much
that is clean, since a wrong effect there is the worst error.
"""
FOREIGN = (3, 4)
"""Places in `KINDS` that the multi-body model of another project takes: a single, a clean case."""
WEAKEST, STRONGEST = 0.1, 1.2
"""Strengths, drawn uniformly in their logarithm."""


def calibration_plans(count: int) -> list[CasePlan]:
    """Return `count` cases with seeds, strengths and combinations of their own."""
    rng = np.random.default_rng(FIRST_SEED)
    names = [str(x) for x in rng.permutation([x for x in FULL if x not in SPRUNG_CAR_ONLY])]
    unlisted = [str(x) for x in rng.permutation(sorted(UNLISTED))]
    foreign = [str(x) for x in rng.permutation(MULTIBODY_EFFECTS)]
    taken = untaken = 0
    plans = []
    for i in range(count):
        kind = KINDS[i % len(KINDS)]
        plant = MULTI_BODY if i % len(KINDS) in FOREIGN else PLANTS[i // 2 % len(PLANTS)]
        strength = float(np.exp(rng.uniform(np.log(WEAKEST), np.log(STRONGEST))))
        injected, title = InjectedMismatch(), "clean"
        if kind == "unlisted":
            title = unlisted[untaken % len(unlisted)]
            untaken += 1
            injected = InjectedMismatch(unlisted={title: strength * UNLISTED[title]})
        elif kind == "single" and plant == MULTI_BODY:
            title = foreign[i // len(KINDS) % len(foreign)]
            full = MULTIBODY_SIZES.get(title, FULL[title])
            injected = InjectedMismatch({title: scale_strength(title, strength, full)})
        elif kind != "clean":
            number = 2 if kind == "pair" else 1
            chosen = [names[(taken + j) % len(names)] for j in range(number)]
            taken += number
            title = "_and_".join(chosen)
            injected = injected_mismatch(tuple(chosen), strength)
        style = ROAD_STYLE_SEQUENCE[i % len(ROAD_STYLE_SEQUENCE)]
        plans.append(
            CasePlan(
                f"calibration_{i:03}_{title}",
                injected,
                FIRST_SEED + i,
                plant,
                strength,
                "track" if set(NEED_GRIP) & set(injected.effects) else style,
                NOISES[i // 3 % len(NOISES)],
            )
        )
    return plans
