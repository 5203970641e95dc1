# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Full factorial of single effects over strength, simulator and noise, and results by factor.

The list of generated cases alternates simulators and noises over its cases, so that a comparison
of two of them also compares other vehicles. Here each effect has one vehicle, drive and road in
all combinations (a paired design).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase

from adk_ros.bench.mismatch.case_matrix import (
    FIRST_SEED,
    FULL_STRENGTH,
    NOISES,
    SEEDS_PER_LIST,
    WEAK,
    WEAKEST,
    CasePlan,
    injected_mismatch,
)
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.errors import UsageError
from adk_ros.plant.injection.injected_drive import PLANTS
from adk_ros.plant.injection.injectors import FULL, SPRUNG_CAR_ONLY

FIRST_FACTORIAL = 500
"""Seed of the first effect within a list, beyond the last case of that list."""


def factorial_plans(names: str, number: int = 0) -> list[CasePlan]:
    """
    Return every combination of these effects with strength, simulator and noise.

    `names`: catalogue effects or patterns with `*`, separated by commas; `number`: of the list,
    which decides on vehicles, drives and roads. Effects that one simulator alone has are combined
    with that one.
    :raises UsageError: no effect has such a name.
    """
    patterns = [x.strip() for x in names.split(",") if x.strip()]
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in FULL):
            raise UsageError(f"no effect is called '{pattern}': names are {', '.join(FULL)}")
    plans = []
    for i, name in enumerate(FULL, FIRST_SEED + number * SEEDS_PER_LIST + FIRST_FACTORIAL):
        if not any(fnmatchcase(name, pattern) for pattern in patterns):
            continue
        for plant in ("spring_car",) if name in SPRUNG_CAR_ONLY else PLANTS:
            for noise in sorted(set(NOISES)):
                for strength in (FULL_STRENGTH, WEAK, WEAKEST):
                    injected = injected_mismatch((name,), strength)
                    case = f"{name}_{strength:g}_{plant}_{noise:g}"
                    plans.append(CasePlan(case, injected, i, plant, strength, "track", noise))
    return plans


def results_by_factor(results: Sequence[CaseResult]) -> tuple[list[str], list[list[str]]]:
    """
    Return header and rows of the mean credit by kind and strength, for each simulator and noise.

    A cell reads "0.98 of 45"; it is empty without a case.
    """
    plants = sorted({x.plant for x in results})
    noises = sorted({x.noise for x in results if x.noise == x.noise})
    selections: list[Callable[[CaseResult], bool]] = [
        *((lambda x, plant=plant: x.plant == plant) for plant in plants),
        *((lambda x, noise=noise: x.noise == noise) for noise in noises),
    ]
    groups: dict[tuple[str, float], list[CaseResult]] = defaultdict(list)
    for result in results:
        groups[result.kind, result.strength].append(result)
    header = ["cases", "strength", *plants, *(f"noise x {noise:g}" for noise in noises)]
    rows = [
        [kind, f"{strength:g}", *(_credit([x for x in group if of(x)]) for of in selections)]
        for (kind, strength), group in sorted(groups.items(), key=lambda x: (x[0][0], -x[0][1]))
    ]
    return header, rows


def _credit(results: Sequence[CaseResult]) -> str:
    if not results:
        return ""
    return f"{sum(x.right for x in results) / len(results):.2f} of {len(results)}"
