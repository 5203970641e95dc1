# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Select hyperparameters on validation data: ridge, observer gains, disturbance gains and decays.

At the end naive predictors take over where the model is not better, see `fallback_weights`.

Each candidate is run by the predictor and scored relative to the best naive predictor at each
horizon and channel. Candidates are scored on the validation data and on the same data with
perturbed commands (input gains torque 0.8, steering 0.85), which to the model is a different car,
so that adaptation counts as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.evaluation import Rollouts, rollout_record
from adk_ros.model.koopman import KoopmanModel
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.signals.channels import Record
from adk_ros.signals.score import naive_predictions, reference_noise, score
from adk_ros.train.dataset import TRAIN, VALIDATION, Split
from adk_ros.train.fallback_weights import find_fallback

_AHEAD = 80
"""Horizon steps that are scored: 2 s."""
_PERTURBED_INPUT_GAIN = np.array([0.8, 0.85])
"""Torque and steering gain of the perturbed car. Empirical, see doc/method.md."""
_WINDOW = 2000
"""Samples in the adaptation's window: 50 s. Empirical, not calibrated."""
_RIDGES = (10000.0, 1000.0, 300.0)
"""Candidates, most conservative first, as in all grids here: weight of the offline model."""
_SLOW = ((0.0, 1.0), (0.02, 0.99), (0.05, 0.99), (0.05, 0.97), (0.1, 0.97))
_FAST = ((0.0, 1.0), (0.3, 0.7), (0.3, 0.9), (0.6, 0.8), (1.0, 0.7), (1.0, 0.9))
"""(gain, decay per tick) of slow and fast disturbance."""
_OBSERVERS = (1.0, 0.6, 0.35, 0.2, 0.1)
_CANDIDATES = len(_RIDGES) + 2 * len(_SLOW) + len(_FAST) + 2 * len(_OBSERVERS)
_TIE_MARGIN, _TIE_MARGIN_SLOW = 0.01, 0.03
"""
The most conservative candidate within this margin of the lowest cost, a mean log ratio, is
selected. Validation data are few, and aggressive gains cost accuracy on other data; most of all
those of the slow disturbance, whose error accumulates for seconds. Empirical, not calibrated.
"""
_DEFAULT_GAINS = replace(
    ObserverGains.none(), slow_gain=np.full(3, 0.05), slow_decay=np.full(3, 0.99)
)
"""Gains while theta0 is selected, so that it is not selected for what a disturbance corrects."""
_WORSE_THAN_NAIVE_WEIGHT = 4.0
"""Extra weight of log ratios above 0: worse than the best naive predictor. Empirical."""
_SELECTION_ROWS = 400
"""About so many rollouts per candidate and case: limits the time."""
_MIN_ERROR_SHARE = 0.05
"""Share of a mean square error that remains after subtracting the estimated measurement noise."""

Note = Callable[[str, int, int], None]
ValidationRecords = list[tuple[Record, BoolArray]]


def select_hyperparameters(
    model: KoopmanModel,
    split: Split,
    note: Note | None = None,
    refitted: Sequence[FloatArray] = (),
) -> KoopmanModel:
    """
    Select theta0, ridge and gains on the validation part; set covariances and mean square change.

    In this order: theta0 (the model's or one of `refitted`) and the ridge, by the mean cost of all
    channels; then, per channel, the slow disturbance, the observer, the fast disturbance, and once
    more the slow disturbance and the observer. At last the fallback.
    """
    cases = _cases(split)
    done, total = 0, _CANDIDATES + (1 + len(refitted) if refitted else 0)

    def cost(candidate: KoopmanModel) -> FloatArray:
        nonlocal done
        if note:
            note("selecting hyperparameters", done, total)
        done += 1
        log_ratio = _log_ratio(candidate, cases)
        return np.asarray(
            (log_ratio + _WORSE_THAN_NAIVE_WEIGHT * np.maximum(log_ratio, 0.0)).mean(axis=(0, 1))
        )

    model = replace(model, mean_square_change=mean_square_change(split))

    def best(candidates: Sequence[KoopmanModel]) -> KoopmanModel:
        costs = np.array([cost(candidate).mean() for candidate in candidates])
        return candidates[int(_most_conservative(costs))]

    if refitted:
        start = replace(model, online=windowed(_RIDGES[-1]), observer_gains=_DEFAULT_GAINS)
        model = best([start, *(replace(start, theta0=theta) for theta in refitted)])
        model = replace(model, observer_gains=ObserverGains.none())
    model = best([replace(model, online=windowed(ridge)) for ridge in _RIDGES])

    def choose(candidates: Sequence[ObserverGains], within: float = _TIE_MARGIN) -> ObserverGains:
        costs = np.array([cost(replace(model, observer_gains=item)) for item in candidates])
        chosen = _most_conservative(costs, within)
        return ObserverGains(
            **{
                name: np.array([getattr(candidates[i], name)[c] for c, i in enumerate(chosen)])
                for name in ObserverGains.names()
            }
        )

    now, each = model.observer_gains, np.ones(3)
    slow = [replace(now, slow_gain=g * each, slow_decay=d * each) for g, d in _SLOW]
    now = choose(slow, _TIE_MARGIN_SLOW)
    # Before the fast disturbance, which would pass the noise that the observer filters.
    now = choose([replace(now, observer_gain=g * each) for g in _OBSERVERS])
    now = choose([replace(now, fast_gain=g * each, fast_decay=d * each) for g, d in _FAST])
    # The fast disturbance can make the slow one unnecessary.
    slow = [replace(now, slow_gain=g * each, slow_decay=d * each) for g, d in _SLOW]
    now = choose(slow, _TIE_MARGIN_SLOW)
    now = choose([replace(now, observer_gain=g * each) for g in _OBSERVERS])
    model = replace(model, observer_gains=now)
    return with_fallback(model, split, note)


def with_fallback(model: KoopmanModel, split: Split, note: Note | None = None) -> KoopmanModel:
    """Return the model with naive predictors where they take over, and with its covariances."""

    def finding(done: int, total: int) -> None:
        if note:
            note("comparing with naive predictors", done, total)

    validated = _validation_rollouts(model, split)
    fallback = find_fallback(model, split, validated, finding)
    if fallback.is_active:
        model = replace(model, fallback=fallback)
        validated = _validation_rollouts(model, split)
    known, held_input = _error_covariances(model, validated, _AHEAD)
    return replace(model, horizon_covariance=known, held_input_covariance=held_input)


def windowed(ridge: float) -> OnlineSettings:
    """Return the settings of windowed least squares with a ridge."""
    return OnlineSettings("windowed", window=_WINDOW, ridge=ridge)


def _most_conservative(costs: FloatArray, within: float = _TIE_MARGIN) -> IntArray:
    """
    Return the index of the first of `costs` (k, ...) within a margin of the lowest.

    Along axis 0.
    """
    return np.asarray(np.argmax(costs <= costs.min(axis=0) + within, axis=0))


def _cases(split: Split) -> tuple[ValidationRecords, ValidationRecords]:
    """Return the validation part as it is, and with perturbed commands."""
    unchanged, perturbed = [], []
    for record, parts in zip(split.records, split.parts, strict=True):
        scored = parts == VALIDATION
        if scored.any():
            unchanged.append((record, scored))
            commands = (
                record.u.mean(axis=0) + (record.u - record.u.mean(axis=0)) / _PERTURBED_INPUT_GAIN
            )
            perturbed.append((replace(record, u=commands), scored))
    return unchanged, perturbed


def _log_ratio(model: KoopmanModel, cases: Sequence[ValidationRecords]) -> FloatArray:
    """Return log(RMSE / best naive RMSE), (cases, steps, 3), the records of a case pooled."""
    rows = sum(int(scored.sum()) for records in cases for _, scored in records)
    stride = max(4, rows // _SELECTION_ROWS)
    result = []
    for records in cases:
        rolled = [
            rollout_record(model, record, None, scored, _AHEAD, stride)
            for record, scored in records
        ]
        rolled = [item for item in rolled if item.rows.size]
        if rolled:
            # A channel that is not measured prefers no candidate.
            result.append(np.nan_to_num(np.log(_against_naive(rolled))))
    # Without a whole horizon in the validation part, the most conservative candidate is selected.
    return np.array(result) if result else np.zeros((1, 1, 3))


def _against_naive(rolled: Sequence[Rollouts]) -> FloatArray:
    naive = [naive_predictions(item.record, item.rows, _AHEAD) for item in rolled]
    count = [item.rows.size for item in rolled]
    floors = np.square([reference_noise(item.record) for item in rolled])
    measured = np.array([item.record.measured for item in rolled])
    known = np.array(count)[:, None] * (np.isfinite(floors) & measured)
    noise = (known * np.nan_to_num(floors)).sum(axis=0) / np.maximum(known.sum(axis=0), 1.0)

    def pooled(predicted: Sequence[FloatArray]) -> FloatArray:
        rmse = [
            score(item.record, item.rows, values).rmse
            for item, values in zip(rolled, predicted, strict=True)
        ]
        # A record that does not measure a channel says nothing of it; the others do.
        measured = np.isfinite(rmse)
        weights = np.array(count)[:, None, None] * measured
        squares = np.where(measured, np.square(rmse), 0.0)
        total = weights.sum(axis=0)
        mean = (weights * squares).sum(axis=0) / np.maximum(total, 1.0)
        return _noise_corrected(noise, np.where(total > 0.0, mean, np.nan))

    # A predictor that needs an IMU counts only if all records have one.
    names = [name for name in naive[0] if all(name in each for each in naive)]
    best = np.min([pooled([each[name] for each in naive]) for name in names], axis=0)
    ours = pooled([item.predicted for item in rolled])
    return np.asarray(np.sqrt(ours / np.maximum(best, 1e-18)))


def _noise_corrected(noise: FloatArray, square: FloatArray) -> FloatArray:
    """
    Return a mean square error (steps, 3) against measurements, corrected for their variance (3,).

    Future measurement noise is unpredictable and adds to every predictor's error. Without the
    correction it hides the benefit of filtering.
    """
    return np.asarray(np.maximum(square - noise, _MIN_ERROR_SHARE * square))


def mean_square_change(split: Split, ahead: int = _AHEAD) -> FloatArray:
    """Return the mean square change (ahead, 3) of the state by horizon, training part, SI."""
    total, count = np.zeros((ahead, 3)), np.zeros((ahead, 1))
    for record in split.of(TRAIN):
        for j in range(1, ahead + 1):
            same = record.episode[j:] == record.episode[:-j]
            change = (record.x_ref[j:] - record.x_ref[:-j])[same]
            change = change[np.isfinite(change).all(axis=1)]
            total[j - 1] += np.square(change).sum(axis=0)
            count[j - 1] += len(change)
    return np.asarray(total / np.maximum(count, 1.0))


def horizon_covariance(model: KoopmanModel, split: Split, ahead: int = _AHEAD) -> FloatArray:
    """Return the error covariance (ahead, 3, 3), future commands known, validation part, SI."""
    return horizon_covariances(model, split, ahead)[0]


def horizon_covariances(
    model: KoopmanModel, split: Split, ahead: int = _AHEAD
) -> tuple[FloatArray, FloatArray]:
    """Return the error covariances commands known and held constant, SI."""
    return _error_covariances(model, _validation_rollouts(model, split, ahead), ahead)


def _validation_rollouts(model: KoopmanModel, split: Split, ahead: int = _AHEAD) -> list[Rollouts]:
    return [
        rollout_record(model, record, None, parts == VALIDATION, ahead, stride=8)
        for record, parts in zip(split.records, split.parts, strict=True)
    ]


def _error_covariances(
    model: KoopmanModel, rollouts: Sequence[Rollouts], ahead: int
) -> tuple[FloatArray, FloatArray]:
    known, held_input = [], []
    for rolled in rollouts:
        if rolled.rows.size:
            future = rolled.rows[:, None] + np.arange(1, ahead + 1)
            known.append(rolled.predicted - rolled.record.x_ref[future])
            held_input.append(rolled.held_input_predictions - rolled.record.x_ref[future])
    if not known:
        increment = np.square(model.scaling.x_scale * model.scaling.step_scale)
        table: FloatArray = np.asarray(np.diag(increment) * np.arange(1, ahead + 1)[:, None, None])
        return table, table.copy()
    return _covariance(known), _covariance(held_input)


def _covariance(errors: list[FloatArray]) -> FloatArray:
    joined = np.concatenate(errors)
    return np.asarray(np.einsum("nhi,nhj->hij", joined, joined) / joined.shape[0])
