# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Comparisons that decide the paper's claims: those that are longer than one line.

DK is the paper's deep Koopman model, ALDK the one with acceleration loss. RLS, FFRLS and SWLS
adapt ALDK: recursive least squares, the same with a forgetting factor, and least squares over a
sliding window. MF is the seven-degree-of-freedom model with the Magic Formula tyre. "max" is the
largest absolute error.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.bench.paper.cases import NOMINAL, PAPER_TESTS
from adk_ros.bench.paper.claims import ClaimEvidence, Comparison, by_channel, less, lowest, reduced
from adk_ros.bench.paper.paper_results import FIVE, printed
from adk_ros.bench.paper.predictors import ALDK, DK, FFRLS, MF, RLS, SWLS
from adk_ros.bench.paper.scores import CHANNELS
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS

MASS_UP, MASS_DOWN, INERTIA_UP, INERTIA_DOWN, MOUNTAIN, SLALOM = PAPER_TESTS[1:]
CHANGED = PAPER_TESTS[1:5]
OTHERS = PAPER_TESTS[1:]
DATA_DRIVEN = (ALDK, RLS, FFRLS, SWLS)
_WINDOW_S = 1.25
"""Length of the SWLS window, s: 50 ticks. Until it is full, SWLS is recursive least squares."""
_TICK_US = TICK_NS * 1e-3
"""Duration of a tick, µs."""


def trend(e: ClaimEvidence) -> list[Comparison]:
    """Compare the RMSE of DK and ALDK with a tenth of the spread of each channel, nominal test."""
    spread = e.spread(NOMINAL, ALDK)
    return [
        less(f"{CHANNELS[c]}: RMSE of {name}", float(e.rmse(NOMINAL, name)[c]),
             "a tenth of the channel's standard deviation,", 0.1 * float(spread[c]))
        for name in (DK, ALDK) for c in range(3)
    ]  # fmt: skip


def dk_yaw(e: ClaimEvidence) -> list[Comparison]:
    """Compare the largest yaw-rate error of ALDK with that of DK, and its reduction."""
    return [
        *by_channel(e, NOMINAL, ALDK, DK, "max", (2,)),
        *reduced(e, NOMINAL, ALDK, DK, (81.8,), channels=(2,)),
    ]


def rls_same(e: ClaimEvidence, test: str) -> list[Comparison]:
    """Compare: RLS improves by less than a factor of 0.7; in the paper the smallest is 0.71."""
    rls, aldk = e.rmse(test, RLS), e.rmse(test, ALDK)
    return [
        less(f"{test}, {CHANNELS[c]}: 0.7 times {ALDK}'s RMSE", 0.7 * float(aldk[c]),
             f"{RLS}'s", float(rls[c]))
        for c in range(3)
    ]  # fmt: skip


def mf_nominal(e: ClaimEvidence) -> list[Comparison]:
    """Compare MF with ALDK in v_x, and whether it is the worst of five in v_y and yaw rate."""
    worst = lowest(e, NOMINAL, MF, FIVE, channels=(1, 2), highest=True)
    return [*by_channel(e, NOMINAL, MF, ALDK, channels=(0,)), *worst]


def rls_max(e: ClaimEvidence) -> list[Comparison]:
    """Compare the largest errors of RLS and ALDK: lower in yaw rate, higher otherwise."""
    return [
        *by_channel(e, NOMINAL, RLS, ALDK, "max", (2,)),
        *by_channel(e, NOMINAL, ALDK, RLS, "max", (0, 1)),
    ]


def oscillation(e: ClaimEvidence) -> list[Comparison]:
    """Compare the change of error from tick to tick of RLS and FFRLS with that of SWLS."""

    def change_rms(name: str) -> FloatArray:
        time_s, error = e.errors(NOMINAL, name)
        within = error[(time_s >= 50.0) & (time_s <= 100.0)]
        if len(within) < 2:
            raise KeyError(NOMINAL)
        return np.asarray(np.sqrt(np.mean(np.diff(within, axis=0) ** 2, axis=0)))

    reference = change_rms(SWLS)
    return [
        less(f"50 to 100 s, {CHANNELS[c]}: twice {SWLS}'s change of error from tick to tick",
             2.0 * float(reference[c]), f"{name}'s", float(change_rms(name)[c]))
        for name in (RLS, FFRLS) for c in range(3)
    ]  # fmt: skip


def efficient(e: ClaimEvidence) -> list[Comparison]:
    """Compare the computing time of SWLS with a tenth of a tick."""
    return [less("computing time per tick with SWLS", e.tick_us(NOMINAL, SWLS),
                 "a tenth of the tick", 0.1 * _TICK_US, unit="µs")]  # fmt: skip


def mass_up(e: ClaimEvidence) -> list[Comparison]:
    """Compare SWLS with ALDK, MF and the data-driven methods at higher mass."""
    return [
        *by_channel(e, MASS_UP, SWLS, ALDK, "max", (1,)),
        *by_channel(e, MASS_UP, SWLS, MF, "max", (1,)),
        *lowest(e, MASS_UP, SWLS, DATA_DRIVEN),
    ]


def inertia_against_mf(e: ClaimEvidence) -> list[Comparison]:
    """Compare the largest errors of SWLS and MF at higher yaw inertia."""
    return [
        *by_channel(e, INERTIA_UP, SWLS, MF, "max", (0,)),
        *reduced(e, INERTIA_UP, SWLS, MF, (63.0,), "max", (2,)),
    ]


def worst_first(e: ClaimEvidence) -> list[Comparison]:
    """Compare the time of SWLS's largest error with the length of its window."""
    time_s, error = e.errors(INERTIA_UP, SWLS)
    when = time_s[np.argmax(np.abs(error), axis=0)]
    return [
        less(f"{INERTIA_UP}, {CHANNELS[c]}: time of SWLS's largest error", float(when[c]),
             "length of the window", _WINDOW_S, unit="s")
        for c in range(3)
    ]  # fmt: skip


def table_shares(test: str) -> FloatArray:
    """Return SWLS's reduction of ALDK's RMSE in the paper's tables, per cent by channel."""
    # Rounded down to whole per cent, so that the paper's rounded figures meet them.
    return np.asarray(np.floor(100.0 * (1.0 - printed(test, SWLS) / printed(test, ALDK))))


def mf_depends(e: ClaimEvidence) -> list[Comparison]:
    """Compare MF's RMSE in the nominal test with that in each changed vehicle."""
    nominal = e.rmse(NOMINAL, MF)
    return [
        less(f"{CHANNELS[c]}: RMSE of {MF}, nominal,", float(nominal[c]), f"{test}'s",
             float(e.rmse(test, MF)[c]))
        for test in CHANGED for c in range(3)
    ]  # fmt: skip


def robust(e: ClaimEvidence) -> list[Comparison]:
    """Compare SWLS with ALDK for each changed vehicle."""
    return [item for test in CHANGED for item in by_channel(e, test, SWLS, ALDK)]


def far_off(e: ClaimEvidence, test: str) -> list[Comparison]:
    """Compare: the v_x error of three methods is over twice that on the training road."""
    return [
        less(f"v_x: twice {name}'s RMSE, nominal,", 2.0 * float(e.rmse(NOMINAL, name)[0]),
             f"{test}'s", float(e.rmse(test, name)[0]))
        for name in (ALDK, RLS, FFRLS)
    ]  # fmt: skip


def fast_and_slow(e: ClaimEvidence) -> list[Comparison]:
    """Compare RMSE in the slalom from 50 to 100 s with that from 15 to 50 s."""
    result = []
    for name in DATA_DRIVEN:
        time_s, error = e.errors(SLALOM, name)
        fast, slow = ((time_s >= a) & (time_s <= b) for a, b in ((15.0, 50.0), (50.0, 100.0)))
        if not (fast.any() and slow.any()):
            raise KeyError(SLALOM)
        for c in range(3):
            slow_rmse, fast_rmse = (
                float(np.sqrt(np.mean(error[part, c] ** 2))) for part in (slow, fast)
            )
            result.append(less(
                f"{CHANNELS[c]}: RMSE of {name} from 50 to 100 s", slow_rmse,
                "half of that from 15 to 50 s,", 0.5 * fast_rmse,
            ))  # fmt: skip
    return result


def slalom_mf(e: ClaimEvidence) -> list[Comparison]:
    """Compare MF with SWLS in the slalom: better in v_x, worse in v_y and yaw rate."""
    return [
        *by_channel(e, SLALOM, MF, SWLS, channels=(0,)),
        *by_channel(e, SLALOM, SWLS, MF, channels=(1, 2)),
    ]


def best_overall(e: ClaimEvidence) -> list[Comparison]:
    """Compare how often SWLS has the lowest RMSE of the five, here and in the paper."""
    here_count = paper_count = 0
    for test in PAPER_TESTS:
        here = np.array([e.rmse(test, name) for name in FIVE])
        there = np.array([printed(test, name) for name in FIVE])
        here_count += int((here.argmin(axis=0) == FIVE.index(SWLS)).sum())
        paper_count += int((there.argmin(axis=0) == FIVE.index(SWLS)).sum())
    total = 3 * len(PAPER_TESTS)
    return [Comparison(
        f"lowest RMSE of the five in {here_count} of {total} entries of Tables 4 to 8 (paper "
        f"{paper_count})",
        here_count >= paper_count,
    )]  # fmt: skip


def throughout(
    tests: Sequence[str], name: str, baseline: str, e: ClaimEvidence
) -> list[Comparison]:
    """Compare a predictor with a baseline in each of several tests."""
    return [item for test in tests for item in by_channel(e, test, name, baseline)]
