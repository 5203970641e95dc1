# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration of the criteria on generated cases that no benchmark contains.

- A correct result leaves an error of noise and of the surrogate model, and a share of the error
  before the correction, since no equation is exact: quantiles over correct results are printed
  next to `MAX_EXPLAINED_RATIO` and `INEXACT_EQUATION_SHARE`.
- On clean cases no effect may gain what an effect must gain: the gain is given as a share of it.
- The conditions of a further effect lie between absent and present ones (`selection_calibration`).
- `SYSTEMATIC_ERROR_SHARE` is the least share with which 90 % of the intervals hold.
- The constants of the confidence have the largest likelihood (`confidence_fit`).
- Every criterion of a decision is halved and doubled (`criteria_sensitivity`).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.confidence_fit import Claim, claims_of, fit_confidence, stated
from adk_ros.bench.mismatch.criteria_sensitivity import Change, sensitivity_lines
from adk_ros.bench.mismatch.mismatch_bench import SCORED
from adk_ros.bench.mismatch.reliability import brier_score
from adk_ros.bench.mismatch.selection_calibration import SelectionCalibration
from adk_ros.mismatch.inference.confidence import ConfidenceModel
from adk_ros.mismatch.inference.result import EXPLAINED
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import (
    INEXACT_EQUATION_SHARE,
    MAX_EXPLAINED_RATIO,
    SYSTEMATIC_ERROR_PER_MATERIALITY,
    SYSTEMATIC_ERROR_PER_SURROGATE_SHARE,
    SYSTEMATIC_ERROR_SHARE,
)
from adk_ros.mismatch.report.result_files import RESULT_FILE
from adk_ros.numerics.constants import QUANTILE_90
from adk_ros.signals.channels import STATE_NAMES

QUANTILE = 0.99
"""Quantile of correct results that a criterion must let pass."""
COVERAGE = 0.9
"""Of the intervals."""
_SHARES = np.linspace(0.0, 0.1, 501)
FOREIGN_SHARE = 0.1
"""
Share of the surrogate error in the residuals' variance, above that of the simulators of this
package (0.09 at most in the 335 cases of the list).
"""
_MIN_CLAIMS = 10
"""With fewer claims, the confidence is not calibrated."""


def answers_of(results: Sequence[CaseResult], out: Path) -> dict[str, dict[str, Any]]:
    """Return the content of mismatch.json by case; the reports of the results are in `out`."""
    return {x.case: _read(out / x.case / RESULT_FILE) for x in results if not x.failure}


def calibrate(
    results: Sequence[CaseResult], out: Path, varied: dict[Change, float] | None = None
) -> list[str]:
    """
    Return a line per calibrated criterion; the reports of the results are in `out`.

    `varied`: scores of cases in which another value of a criterion changes a decision.
    """
    ratios: list[float] = []
    shares: list[float] = []
    gains: list[float] = []
    errors: list[tuple[float, float, float]] = []
    foreign: list[tuple[float, float, float]] = []
    claims: list[Claim] = []
    selection = SelectionCalibration()
    answers = answers_of(results, out)
    for result in results:
        if result.failure:
            continue
        answer = answers[result.case]
        label = _read(out / result.case / SCORED)["label"]
        claims += claims_of(label, answer)
        selection.add([effect["name"] for effect in label["effects"]], answer)
        if result.kind == "none":
            steps = answer["selection"]["steps"][1:]
            gains.append(max((x["gain"] / x["required"] for x in steps), default=0.0))
        if result.right < 1.0:
            continue
        ratio, share = largest_errors(answer["fit"]["horizons"])
        if result.kind == "none":
            ratios.append(ratio)
        elif answer["verdict"] == EXPLAINED:
            shares.append(share)
        found = interval_errors(label, answer)
        errors += found
        if answer["selection"]["surrogate_variance_share"] > FOREIGN_SHARE:
            foreign += found
    return [
        _quantile_line("MAX_EXPLAINED_RATIO", MAX_EXPLAINED_RATIO, ratios),
        _quantile_line("INEXACT_EQUATION_SHARE", INEXACT_EQUATION_SHARE, shares),
        _gain_line(gains),
        *selection.lines(),
        _interval_line(f"SYSTEMATIC_ERROR_SHARE {SYSTEMATIC_ERROR_SHARE:g}", errors),
        _interval_line(
            f"SYSTEMATIC_ERROR_PER_SURROGATE_SHARE {SYSTEMATIC_ERROR_PER_SURROGATE_SHARE:g}, "
            f"where the surrogate error is more than {FOREIGN_SHARE:g} of the variance",
            foreign,
        ),
        *_confidence_lines(claims),
        *sensitivity_lines(results, answers, varied or {}),
    ]


def largest_errors(horizons: dict[str, Any]) -> tuple[float, float]:
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


def interval_errors(
    label: dict[str, Any], answer: dict[str, Any]
) -> list[tuple[float, float, float]]:
    """
    Return error, size and standard deviation without its systematic share, by parameter.

    Of parameters that are fitted as they are, not by their inverse.
    """
    out = []
    true = {effect["name"]: effect["params"] for effect in label["effects"]}
    for effect in answer["effects"]:
        for parameter in EFFECTS[effect["name"]].parameters:
            value = true.get(effect["name"], {}).get(parameter.name)
            if value is None or parameter.inverse:
                continue
            given = effect["parameters"][parameter.name]
            size = abs(given["value"] - parameter.neutral)
            deviation = 0.5 * (given["high"] - given["low"]) / QUANTILE_90
            variance = deviation**2 - (SYSTEMATIC_ERROR_SHARE * size) ** 2
            out.append((abs(given["value"] - value), size, float(np.sqrt(max(variance, 0.0)))))
    return out


def systematic_share(errors: Sequence[tuple[float, float, float]]) -> float:
    """Return the least systematic share with which `COVERAGE` of the intervals hold."""
    error, size, sigma = np.array(errors).T
    for share in _SHARES:
        if np.mean(error <= QUANTILE_90 * np.hypot(sigma, share * size)) >= COVERAGE:
            return float(share)
    return float(_SHARES[-1])


def _quantile_line(name: str, present: float, values: Sequence[float]) -> str:
    if not values:
        return f"{name} {present:g}: no correct result"
    return (
        f"{name} {present:g}: {100.0 * QUANTILE:g} % of {len(values)} correct results are below "
        f"{np.quantile(values, QUANTILE):.3g}, the largest is {np.max(values):.3g}"
    )


def _gain_line(gains: Sequence[float]) -> str:
    """Return how near clean cases come to a false alarm, with the rate's upper bound."""
    if not gains:
        return "MIN_GAIN: no clean case"
    alarms = sum(gain > 1.0 for gain in gains)
    high = binomtest(alarms, len(gains)).proportion_ci(0.9).high
    return (
        f"MIN_GAIN and its shares: the best effect gains at most {np.max(gains):.2f} of what is "
        f"required on {len(gains)} clean cases, 95 % below {np.quantile(gains, 0.95):.2f}; "
        f"false alarms {alarms}, so at most {100.0 * high:.1f} % (95 % confidence)"
    )


def _interval_line(name: str, errors: Sequence[tuple[float, float, float]]) -> str:
    if not errors:
        return f"{name}: no parameter"
    held = sum(e <= QUANTILE_90 * np.hypot(s, SYSTEMATIC_ERROR_SHARE * x) for e, x, s in errors)
    return (
        f"{name}: {held} of {len(errors)} intervals hold; {100.0 * COVERAGE:g} % with a share of "
        f"{systematic_share(errors):.4f} "
        f"(SYSTEMATIC_ERROR_PER_MATERIALITY {SYSTEMATIC_ERROR_PER_MATERIALITY:g})"
    )


def _confidence_lines(claims: Sequence[Claim]) -> list[str]:
    right = sum(claim.right for claim in claims)
    found = f"{len(claims)} claims, {right} of them right"
    if len(claims) < _MIN_CLAIMS:
        return [f"confidence: {found}: not enough to calibrate"]
    present, best = ConfidenceModel(), fit_confidence(claims)
    return [
        f"confidence: {found}; Brier score {brier_score(stated(present, claims)):.4f} as it is, "
        f"{brier_score(stated(best, claims)):.4f} with",
        f"  UNLISTED_ODDS {best.unlisted_odds:.3g} (now {present.unlisted_odds:g}), "
        f"UNLISTED_EXPONENT {best.unlisted_exponent:.3g} (now {present.unlisted_exponent:g}), "
        f"CONFIDENCE_PER_SURROGATE_ERROR {best.per_surrogate_error:.3g} "
        f"(now {present.per_surrogate_error:g})",
    ]


def _read(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content
