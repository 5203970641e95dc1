# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What of a model is chosen on validation data alone: ridge, gains and decays, covariance.

Chosen by the predictor itself, `Predictor.step` over the samples, scored against the best naive
predictor of each cell. To value adaptation as well as the fit, every choice is also made on the
validation data with its commands scaled (torque 0.8, steering 0.85), which to the model is a car
that answers otherwise than the one it knows.
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

_AHEAD = 80
_PERTURBED_INPUT_GAIN = np.array([0.8, 0.85])
_WINDOW = 2000
_RIDGES = (10000.0, 1000.0, 300.0)
_SLOW = ((0.0, 1.0), (0.02, 0.99), (0.05, 0.99), (0.05, 0.97), (0.1, 0.97))
_FAST = ((0.0, 1.0), (0.3, 0.7), (0.3, 0.9), (0.6, 0.8), (1.0, 0.7), (1.0, 0.9))
_OBSERVERS = (1.0, 0.6, 0.35, 0.2, 0.1)
_TRIALS = len(_RIDGES) + 2 * len(_SLOW) + len(_FAST) + 2 * len(_OBSERVERS)
_TIE_MARGIN, _TIE_MARGIN_SLOW = 0.01, 0.03
"""
Of the cost, a mean log ratio: what is chosen is the least bold setting, they are listed in that
order, within so much of the best. Validation data are few, and boldness is paid for on others;
most by a slow disturbance, whose error adds up for seconds.
"""
_QUICK = replace(ObserverGains.none(), slow_gain=np.full(3, 0.05), slow_decay=np.full(3, 0.99))
"""With which theta0 is chosen: not for what a disturbance takes care of anyway."""
_WORSE_THAN_NAIVE_WEIGHT = 4.0
"""Weight of how far a cell is behind the best naive predictor, beside the mean of all cells."""
_TUNING_ROWS = 400
_LEAST_SHARE = 0.05
"""Of a square error that is not put down to the measurement's noise, which is an estimate."""

Note = Callable[[str, int, int], None]
ValidationDrives = list[tuple[Record, BoolArray]]


def select_hyperparameters(
    model: KoopmanModel,
    split: Split,
    note: Note | None = None,
    refitted: Sequence[FloatArray] = (),
) -> KoopmanModel:
    """
    Choose theta0, ridge and correction on the validation part; set covariances, usual change.

    One after the other: theta0, the model's or one of `refitted`, and the ridge, by the mean over
    all cells, then the slow disturbance, the observer, the fast disturbance, the slow one and the
    observer once more, each channel by its own cells.
    """
    cases = _cases(split)
    done, total = 0, _TRIALS + (1 + len(refitted) if refitted else 0)

    def cost(trial: KoopmanModel) -> FloatArray:
        nonlocal done
        if note:
            note("tuning adaptation", done, total)
        done += 1
        ratio = _ratio(trial, cases)
        return np.asarray(
            (ratio + _WORSE_THAN_NAIVE_WEIGHT * np.maximum(ratio, 0.0)).mean(axis=(0, 1))
        )

    model = replace(model, mean_square_change=mean_square_change(split))

    def best(rivals: Sequence[KoopmanModel]) -> KoopmanModel:
        return rivals[int(_most_conservative(np.array([cost(rival).mean() for rival in rivals])))]

    if refitted:
        start = replace(model, online=windowed(_RIDGES[-1]), observer_gains=_QUICK)
        model = best([start, *(replace(start, theta0=theta) for theta in refitted)])
        model = replace(model, observer_gains=ObserverGains.none())
    model = best([replace(model, online=windowed(ridge)) for ridge in _RIDGES])

    def choose(corrections: Sequence[ObserverGains], within: float = _TIE_MARGIN) -> ObserverGains:
        costs = np.array([cost(replace(model, observer_gains=item)) for item in corrections])
        chosen = _most_conservative(costs, within)
        return ObserverGains(
            **{
                name: np.array([getattr(corrections[i], name)[c] for c, i in enumerate(chosen)])
                for name in ObserverGains.names()
            }
        )

    now, each = model.observer_gains, np.ones(3)
    slow = [replace(now, slow_gain=g * each, slow_decay=d * each) for g, d in _SLOW]
    now = choose(slow, _TIE_MARGIN_SLOW)
    # Before the fast one: that would take noise back that the observer had better not let in.
    now = choose([replace(now, observer_gain=g * each) for g in _OBSERVERS])
    now = choose([replace(now, fast_gain=g * each, fast_decay=d * each) for g, d in _FAST])
    # The fast one may have made it needless.
    slow = [replace(now, slow_gain=g * each, slow_decay=d * each) for g, d in _SLOW]
    now = choose(slow, _TIE_MARGIN_SLOW)
    now = choose([replace(now, observer_gain=g * each) for g in _OBSERVERS])
    model = replace(model, observer_gains=now)
    known, held = horizon_covariances(model, split)
    return replace(model, horizon_covariance=known, held_input_covariance=held)


def windowed(ridge: float) -> OnlineSettings:
    """Return the adaptation that is tuned."""
    return OnlineSettings("windowed", window=_WINDOW, ridge=ridge)


def _most_conservative(costs: FloatArray, within: float = _TIE_MARGIN) -> IntArray:
    """Index of the first of the `costs` (k, ...) `within` so much of the least, along axis 0."""
    return np.asarray(np.argmax(costs <= costs.min(axis=0) + within, axis=0))


def _cases(split: Split) -> tuple[ValidationDrives, ValidationDrives]:
    """The validation part as it is, and with another car's commands."""
    same, other = [], []
    for record, parts in zip(split.records, split.parts, strict=True):
        scored = parts == VALIDATION
        if scored.any():
            same.append((record, scored))
            changed = (
                record.u.mean(axis=0) + (record.u - record.u.mean(axis=0)) / _PERTURBED_INPUT_GAIN
            )
            other.append((replace(record, u=changed), scored))
    return same, other


def _ratio(model: KoopmanModel, cases: Sequence[ValidationDrives]) -> FloatArray:
    """Log of RMSE over the best naive predictor's, (cases, steps, 3); a case's drives as one."""
    rows = sum(int(scored.sum()) for drives in cases for _, scored in drives)
    stride = max(4, rows // _TUNING_ROWS)
    result = []
    for drives in cases:
        rolled = [
            rollout_record(model, record, None, scored, _AHEAD, stride)
            for record, scored in drives
        ]
        rolled = [item for item in rolled if item.rows.size]
        if rolled:
            result.append(np.log(_against_naive(rolled)))
    # Too short a validation part for a horizon: nothing to choose by, the first choice stands.
    return np.array(result) if result else np.zeros((1, 1, 3))


def _against_naive(rolled: Sequence[Rollouts]) -> FloatArray:
    naive = [naive_predictions(item.record, item.rows, _AHEAD) for item in rolled]
    count = [item.rows.size for item in rolled]
    floors = np.square([reference_noise(item.record) for item in rolled])
    noise = np.average(np.where(np.isfinite(floors), floors, 0.0), axis=0, weights=count)

    def pooled(predicted: Sequence[FloatArray]) -> FloatArray:
        rmse = [
            score(item.record, item.rows, values).rmse
            for item, values in zip(rolled, predicted, strict=True)
        ]
        return _noise_corrected(noise, np.average(np.square(rmse), axis=0, weights=count))

    # One that needs an IMU is no rival where some of the drives have none.
    names = [name for name in naive[0] if all(name in each for each in naive)]
    best = np.min([pooled([each[name] for each in naive]) for name in names], axis=0)
    ours = pooled([item.predicted for item in rolled])
    return np.asarray(np.sqrt(ours / np.maximum(best, 1e-18)))


def _noise_corrected(noise: FloatArray, square: FloatArray) -> FloatArray:
    """
    What a mean square error against a measurement (steps, 3) would be against the truth.

    The noise of a tick to come is in nobody's prediction, so its square (3,) adds to everybody's;
    left in, it hides what a filter gains.
    """
    return np.asarray(np.maximum(square - noise, _LEAST_SHARE * square))


def mean_square_change(split: Split, ahead: int = _AHEAD) -> FloatArray:
    """Mean square change (ahead, 3) of the state over each step of the horizon, training, SI."""
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
    """Covariance (ahead, 3, 3) of the errors under known commands on the validation part, SI."""
    return horizon_covariances(model, split, ahead)[0]


def horizon_covariances(
    model: KoopmanModel, split: Split, ahead: int = _AHEAD
) -> tuple[FloatArray, FloatArray]:
    """The same under commands that are known, and under commands that are held."""
    known, held = [], []
    for record, parts in zip(split.records, split.parts, strict=True):
        rolled = rollout_record(model, record, None, parts == VALIDATION, ahead, stride=8)
        if rolled.rows.size:
            future = rolled.rows[:, None] + np.arange(1, ahead + 1)
            known.append(rolled.predicted - record.x_ref[future])
            held.append(rolled.held_input_predictions - record.x_ref[future])
    if not known:
        usual = np.square(model.scaling.x_scale * model.scaling.step_scale)
        table: FloatArray = np.asarray(np.diag(usual) * np.arange(1, ahead + 1)[:, None, None])
        return table, table.copy()
    return _covariance(known), _covariance(held)


def _covariance(errors: list[FloatArray]) -> FloatArray:
    joined = np.concatenate(errors)
    return np.asarray(np.einsum("nhi,nhj->hij", joined, joined) / joined.shape[0])
