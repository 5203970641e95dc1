# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration of the held-out criteria on generated cases that no benchmark contains.

A correct result leaves an error of noise and of the surrogate model, and a share of the error
before the correction, since no equation is exact. `MAX_EXPLAINED_RATIO` and
`INEXACT_EQUATION_SHARE` limit the two; their calibrated values are quantiles over correct results.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bench.mismatch.case_generator import InjectedMismatch
from adk_ros.bench.mismatch.case_matrix import (
    NEED_GRIP,
    NOISES,
    ROAD_STYLE_SEQUENCE,
    CasePlan,
    injected_mismatch,
)
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.injected_drive import PLANTS
from adk_ros.bench.mismatch.injectors import FULL, SPRUNG_CAR_ONLY
from adk_ros.mismatch.library.criteria import INEXACT_EQUATION_SHARE, MAX_EXPLAINED_RATIO
from adk_ros.mismatch.report.result_files import RESULT_FILE
from adk_ros.signals.channels import STATE_NAMES

FIRST_SEED = 500_000
"""Seed of the first case: those of the benchmark begin at 1000."""
CLEAN_SHARE = 2
"""Every second case is clean."""
QUANTILE = 0.99
"""Quantile of correct results that a criterion must let pass."""


@dataclass(frozen=True)
class Calibration:
    """A criterion's present value, and the quantile over the largest values of correct results."""

    name: str
    present: float
    quantile: float
    largest: float
    cases: int

    def __str__(self) -> str:
        return (
            f"{self.name} {self.present:g}: {100.0 * QUANTILE:g} % of {self.cases} correct "
            f"results are below {self.quantile:.3g}, the largest is {self.largest:.3g}"
        )


def calibration_plans(count: int) -> list[CasePlan]:
    """Return `count` cases: clean ones and single effects in turn, with seeds of their own."""
    names = [name for name in FULL if name not in SPRUNG_CAR_ONLY]
    plans = []
    for i in range(count):
        name = "" if i % CLEAN_SHARE == 0 else names[(7 * i) % len(names)]
        injected = injected_mismatch((name,), 1.0) if name else InjectedMismatch()
        style = "track" if name in NEED_GRIP else ROAD_STYLE_SEQUENCE[i % 3]
        plans.append(
            CasePlan(
                f"calibration_{i:03}_{name or 'clean'}",
                injected,
                FIRST_SEED + i,
                PLANTS[i // 2 % len(PLANTS)],
                road_style=style,
                noise=NOISES[i // 3 % len(NOISES)],
            )
        )
    return plans


def calibrate(results: Sequence[CaseResult], out: Path) -> list[Calibration]:
    """Return the calibration of both criteria from the correct results; reports are in `out`."""
    ratios, shares = [], []
    for result in results:
        if result.right < 1.0 or result.failure:
            continue
        answer = json.loads((out / result.case / RESULT_FILE).read_text(encoding="utf-8"))
        ratio, share = _largest(answer["fit"]["horizons"])
        if result.kind == "none":
            ratios.append(ratio)
        else:
            shares.append(share)
    return [
        _calibration("MAX_EXPLAINED_RATIO", MAX_EXPLAINED_RATIO, ratios),
        _calibration("INEXACT_EQUATION_SHARE", INEXACT_EQUATION_SHARE, shares),
    ]


def _calibration(name: str, present: float, values: Sequence[float]) -> Calibration:
    if not values:
        return Calibration(name, present, np.nan, np.nan, 0)
    return Calibration(
        name, present, float(np.quantile(values, QUANTILE)), float(np.max(values)), len(values)
    )


def _largest(horizons: dict[str, Any]) -> tuple[float, float]:
    """
    Return the largest error over the expected one, and the largest share of the error before.

    The share is of what the expected error, times its criterion, does not allow.
    """
    ratio = share = 0.0
    for errors in horizons.values():
        for state in STATE_NAMES:
            before, expected = errors["before"][state], errors["expected"][state]
            limited = errors["ratio"][state]
            if before is None or limited is None:
                continue
            noise = MAX_EXPLAINED_RATIO * expected
            error = limited * float(np.hypot(noise, INEXACT_EQUATION_SHARE * before))
            ratio = max(ratio, error / expected)
            share = max(share, float(np.sqrt(max(error**2 - noise**2, 0.0))) / before)
    return ratio, share
