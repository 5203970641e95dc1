# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Name a change: fit the likely effects from the onset on, and compare them as offline.

Alternatives, equivalent effects, intervals, confidence and the verdict "unknown" have the rules
and constants of `inference.identifiability`, `inference.decision` and `inference.confidence`. A
perfect model's loss is not assumed but measured: it is that of the blocks before the onset.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.confidence import ABSENT, Evidence
from adk_ros.mismatch.inference.effect_intervals import confidence_intervals
from adk_ros.mismatch.inference.final_estimate import with_posterior
from adk_ros.mismatch.inference.identifiability import (
    STRUCTURALLY_EQUIVALENT,
    CompetingEffect,
    canonical_effect,
    has_inactive_parameter,
)
from adk_ros.mismatch.inference.result import EXPLAINED, UNKNOWN, IdentifiedEffect
from adk_ros.mismatch.library.criteria import (
    INDISTINGUISHABLE_LOSS,
    INDISTINGUISHABLE_LOSS_SHARE,
    MAX_EXCESS_PER_NOISE,
    MAX_EXCESS_PER_NULL_EXCESS,
)
from adk_ros.mismatch.library.effect import TIME
from adk_ros.mismatch.library.search_limits import MAX_COMPETITORS
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.watch.change_fit import ChangeFit, FittedChange
from adk_ros.mismatch.watch.change_statistics import ChangeStatistics, LinearChange
from adk_ros.mismatch.watch.settings import BLOCK_S, MIN_BLOCKS_AFTER
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import QUANTILE_90

_MIN_GAIN_SHARE = 0.1
"""Least linear gain of an effect that is fitted, as a share of the best: a limit of the search."""
_MAX_FITTED = 10
"""Most effects that are fitted: about 2 s of computing."""
_MAX_REFITTED = 4
"""Most effects that are fitted again, with the weights of the best."""
_FLAT_LOSS = 10.0
"""
Linear gain by which an onset may be worse than the best to be examined: a likelihood ratio of 150,
beyond the odds of 20 at which explanations are indistinguishable.
"""
_MAX_ONSET_SPAN_S = 60.0
_ONSET_STEP_S, _FINE_STEP_S = 1.0, 0.25
_REFERENCE_SIGMAS = 3.0
"""Deviations of the reference's loss per block that the loss after the onset may differ by."""
_MAX_CHANNELS = 2


@dataclass(frozen=True)
class NamedChange:
    """Verdict, best effect, onset with its 90 % interval, and what the effect leaves."""

    verdict: str
    best: IdentifiedEffect
    theta: tuple[float, ...]
    onset_s: float
    onset_low_s: float
    onset_high_s: float
    excess_ratio: float
    channels: tuple[str, ...]


def name_change(
    statistics: ChangeStatistics, changes: list[LinearChange]
) -> Generator[None, None, NamedChange]:
    """
    Yield between pieces of work of some 0.1 s; return the named change.

    `changes`: every candidate at every onset, see `ChangeStatistics.all_changes`.
    """
    tried = _screened(changes)
    first = tried[0]
    begin_s, end_s = _onset_range(statistics, changes, first)
    blocks = [item.block for item in statistics.blocks]
    index = next(i for i, block in enumerate(blocks) if block.end_s > begin_s)
    index = min(max(index, 1), len(blocks) - MIN_BLOCKS_AFTER)
    data = ChangeFit(statistics, index)
    onset_s = blocks[first.onset_block].begin_s
    yield
    best = data.fit(first.candidate.effect, first.theta(), onset_s)
    data.reweigh(best.active)
    yield
    onset_s, _ = _refined_onset(data, best, np.arange(begin_s, end_s, _ONSET_STEP_S))
    yield
    fitted: list[FittedChange] = []
    for change in tried:
        fitted.append(data.fit(change.candidate.effect, change.theta(), onset_s))
        yield
    fitted.sort(key=lambda x: x.penalised_loss)
    data.reweigh(fitted[0].active)
    grid = np.arange(onset_s - 2.0 * _ONSET_STEP_S, onset_s + 2.0 * _ONSET_STEP_S, _FINE_STEP_S)
    onset_s, _ = _refined_onset(data, fitted[0], grid)
    yield
    refitted = []
    for one in fitted[:_MAX_REFITTED]:
        refitted.append(data.fit(one.active.effect, one.active.theta, onset_s))
        yield
    best, others = _ranked(refitted)
    every = np.unique(np.concatenate([np.arange(begin_s, end_s, _ONSET_STEP_S), grid, [onset_s]]))
    onset_s, within = _refined_onset(data, best, every)
    yield
    return _named(data, best, others, onset_s, within)


def _screened(changes: list[LinearChange]) -> list[LinearChange]:
    """Return the effects worth a fit, each at its best onset, best first."""
    best: dict[str, LinearChange] = {}
    for change in changes:
        name = change.candidate.effect.name
        if name not in best or change.gain > best[name].gain:
            best[name] = change
    ranked = sorted(best.values(), key=lambda x: -x.gain)
    likely = {
        *ranked[0].candidate.effect.confusables,
        *STRUCTURALLY_EQUIVALENT.get(ranked[0].candidate.effect.name, ()),
    }
    return [
        change
        for i, change in enumerate(ranked)
        if i == 0
        or change.gain > _MIN_GAIN_SHARE * ranked[0].gain
        or (change.candidate.effect.name in likely and change.gain > 0.0)
    ][:_MAX_FITTED]


def _onset_range(
    statistics: ChangeStatistics, changes: list[LinearChange], first: LinearChange
) -> tuple[float, float]:
    """Return the times between which the onset of the first change may lie."""
    likely = [
        change.onset_block
        for change in changes
        if change.candidate is first.candidate and change.gain > first.gain - _FLAT_LOSS
    ]
    blocks = [item.block for item in statistics.blocks]
    at_s = blocks[first.onset_block].begin_s
    begin_s = max(blocks[min(likely)].begin_s - BLOCK_S, at_s - _MAX_ONSET_SPAN_S)
    end_s = min(blocks[max(likely)].begin_s + BLOCK_S, at_s + _MAX_ONSET_SPAN_S)
    return begin_s, end_s


def _refined_onset(
    data: ChangeFit, fitted: FittedChange, onsets_s: FloatArray
) -> tuple[float, tuple[float, float]]:
    """Return the best of the given onsets, and the 90 % interval of the profile likelihood."""
    losses = data.onset_losses(fitted.active, onsets_s)
    within = onsets_s[losses <= losses.min() + QUANTILE_90**2]
    return float(onsets_s[int(np.argmin(losses))]), (float(within[0]), float(within[-1]))


def _ranked(fitted: list[FittedChange]) -> tuple[FittedChange, list[FittedChange]]:
    """Return the best change in its canonical form, and the others."""
    fitted = sorted(fitted, key=lambda x: x.penalised_loss)
    best = fitted[0]
    canonical = canonical_effect(best.active, best.deviations.tolist())
    for one in fitted:
        if one.active.effect is canonical:
            best = one
    return best, [one for one in fitted if one is not best]


def _named(
    data: ChangeFit,
    best: FittedChange,
    others: list[FittedChange],
    onset_s: float,
    within: tuple[float, float],
) -> NamedChange:
    null = data.null_losses()
    gain = float(null.sum() - best.block_losses.sum())
    margin = INDISTINGUISHABLE_LOSS + INDISTINGUISHABLE_LOSS_SHARE * max(gain, 0.0)
    equivalent = STRUCTURALLY_EQUIVALENT.get(best.active.effect.name, ())
    competitors = []
    names, differences = [ABSENT], [null - best.block_losses]
    for one in others:
        name, difference = one.active.effect.name, one.penalised_loss - best.penalised_loss
        is_alternative = (
            (difference < margin or name in equivalent)
            and one.active.is_material()
            and not has_inactive_parameter(one.active, best.active)
        )
        if not is_alternative and not has_inactive_parameter(one.active, best.active):
            names.append(name)
            differences.append(one.block_losses - best.block_losses)
        competitors.append(
            CompetingEffect(best.active.effect.name, name, difference, one.active, is_alternative)
        )
    competitors.sort(key=lambda x: x.loss_difference)
    ratio = _excess_ratio(data, best, null)
    evidence = Evidence(
        tuple(names), np.array(differences), np.zeros(len(names)), data.surrogate_error()
    )
    identified = IdentifiedEffect(
        best.active.effect,
        confidence_intervals(best.active, best.deviations.tolist()),
        np.nan,
        [x.name for x in competitors if x.alternative],
        TIME,
        [],
        gain,
        tuple(competitors[:MAX_COMPETITORS]),
        onset_s=onset_s,
        evidence=evidence,
    )
    return NamedChange(
        UNKNOWN if ratio > 1.0 else EXPLAINED,
        with_posterior(identified, ratio),
        best.active.theta,
        onset_s,
        *within,
        ratio,
        _channels(data),
    )


def _excess_ratio(data: ChangeFit, best: FittedChange, null: FloatArray) -> float:
    """
    Return the loss that the best effect leaves beyond the reference's, over what is allowed.

    The block in which the effect sets in does not count: its course is not known.
    """
    onset_s = best.active.activation.onset_s or 0.0
    settled = np.array([block.begin_s >= onset_s for block in data.after])
    if not settled.any():
        settled[:] = True
    rows = data.rows[settled]
    mean = float(data.reference_losses.mean())
    scatter = float(data.reference_losses.std()) / np.sqrt(settled.sum())
    expected = mean * rows.sum()
    left = float(best.block_losses[settled].sum()) - expected
    before = float(null[settled].sum()) - expected
    allowed = max(
        MAX_EXCESS_PER_NOISE * expected + _REFERENCE_SIGMAS * scatter * rows.sum(),
        MAX_EXCESS_PER_NULL_EXCESS * before,
    )
    return float(max(left, 0.0) / allowed)


def _channels(data: ChangeFit) -> tuple[str, ...]:
    """Return the channels whose residuals have risen most without a change."""
    risen = data.null_channel_losses()
    order = np.argsort(-risen)[:_MAX_CHANNELS]
    return tuple(CHANNELS[i] for i in order)
