# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a correction raises a held-out error, and whether beyond chance."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from adk_ros.mismatch.deployment.held_out import REPORTED_HORIZON, START_STRIDE_S, rmse
from adk_ros.mismatch.inference.block_scores import BLOCK_S
from adk_ros.mismatch.library.criteria import (
    MAX_EXPLAINED_RATIO,
    MAX_IMPROVED_RATIO,
    MAX_RAISED_RATIO,
    MIN_RAISED_BLOCKS,
    RAISED_FALSE_ALARM,
)
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import STATE_NAMES


def raised_states(before: FloatArray, after: FloatArray, not_judged: Sequence[str]) -> list[str]:
    """Return the states whose error (horizons, 3) a correction raises at any horizon."""
    higher = ~(after <= MAX_RAISED_RATIO * before) & np.isfinite(before)
    return [
        name for i, name in enumerate(STATE_NAMES) if higher[:, i].any() and name not in not_judged
    ]


def raised_beyond_chance(
    before: FloatArray, after: FloatArray, not_judged: Sequence[str]
) -> list[str]:
    """Return the states whose errors (n, horizons, 3) rise, and significantly, at any horizon."""
    rises = significant_rise(before, after)
    first, then = rmse(before), rmse(after)
    rises &= ~(then <= MAX_RAISED_RATIO * first) & np.isfinite(first)
    return [
        name for i, name in enumerate(STATE_NAMES) if rises[:, i].any() and name not in not_judged
    ]


def lowers_on_the_whole(before: FloatArray, after: FloatArray, not_judged: Sequence[str]) -> bool:
    """Whether the geometric mean of the errors (horizons, 3) of all judged states is lower."""
    return float(np.log(_ratios(before, after, not_judged)).sum()) < 0.0


def largest_rise(before: FloatArray, after: FloatArray, not_judged: Sequence[str]) -> float:
    """Return the largest error of a judged state after over before, at any horizon."""
    return float(_ratios(before, after, not_judged).max(initial=0.0))


def _ratios(before: FloatArray, after: FloatArray, not_judged: Sequence[str]) -> FloatArray:
    """Return the errors (horizons, 3) after over before of judged states, those that exist."""
    judged = [i for i, name in enumerate(STATE_NAMES) if name not in not_judged]
    first, then = before[:, judged], after[:, judged]
    known = np.isfinite(first) & np.isfinite(then) & (first > 0.0) & (then > 0.0)
    return np.asarray(then[known] / first[known])


def improves(
    before: FloatArray, after: FloatArray, expected: FloatArray, not_judged: Sequence[str]
) -> bool:
    """
    Whether a correction lowers an error above the expected one, and raises none beyond chance.

    `before` and `after`: errors (n, horizons, 3). At the reported horizon no error may rise by
    more than `MAX_RAISED_RATIO`. At another one, a rise is chance where it is not significant, or
    where noise and the surrogate's own error still explain the error.
    """
    judged = [i for i, name in enumerate(STATE_NAMES) if name not in not_judged]
    first, then = (rmse(x)[:, judged] for x in (before, after))
    noise = expected[:, judged]
    lower = (first > noise) & (then <= MAX_IMPROVED_RATIO * first)
    higher = ~(then <= MAX_RAISED_RATIO * first) & np.isfinite(first)
    rises = significant_rise(before[:, :, judged], after[:, :, judged])
    beyond_chance = rises & ~(then <= MAX_EXPLAINED_RATIO * noise)
    beyond_chance[REPORTED_HORIZON] = True
    return bool(lower[REPORTED_HORIZON].any() and not (higher & beyond_chance).any())


def significant_rise(before: FloatArray, after: FloatArray) -> BoolArray:
    """
    Return whether squared errors (n, ...) of the same starts are larger than before.

    Student's t over the means of blocks of `BLOCK_S`, after which errors of predictions
    over two seconds are independent. Never with fewer than `MIN_RAISED_BLOCKS` of them.
    """
    size = round(BLOCK_S / START_STRIDE_S)
    blocks = len(before) // size
    shape = before.shape[1:]
    if blocks < MIN_RAISED_BLOCKS:
        return np.zeros(shape, dtype=bool)
    difference = (after**2 - before**2)[: blocks * size].reshape(blocks, size, *shape)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # A block of which no start counts.
        means = np.nanmean(difference, axis=1)
        spread = np.nanstd(means, axis=0, ddof=1) / np.sqrt(np.isfinite(means).sum(axis=0))
        critical = student.ppf(1.0 - RAISED_FALSE_ALARM, blocks - 1)
        found = np.nanmean(means, axis=0) > critical * spread
    return np.asarray(found)
