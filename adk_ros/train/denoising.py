# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Filter the yaw rate of the training data with an observer, as the predictor does at run time.

    r^_k = p_k + K (r_k - p_k)           p_k: prediction from k - 1 by a first, shorter training

At run time the predictor lifts the observer's state, not the measurement. A network trained on
noisy yaw rates learns to ignore small differences between them, also where they are clean: in the
observer's state and in all later steps of a rollout. K is the smallest gain at which the RMS
innovation of the quadratic features on the training data is within 2 % of the minimum. K = 1, no
filtering, results if the measurements are clean or the quadratic features do not predict them.

Only the yaw rate is filtered: its input, the steering, is known. Speeds also depend on slope and
wind, so an observer lags; models trained on filtered speeds were less accurate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.evaluation import observed_states
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import Record
from adk_ros.train.assemble import assemble
from adk_ros.train.dataset import sequences
from adk_ros.train.hyperparameters import windowed
from adk_ros.train.network_fit import Step, fit, quadratic_features_of, scaling_of
from adk_ros.train.quadratic_features import QuadraticFeatures, input_columns, newest
from adk_ros.train.train_settings import TrainSettings

_FIRST_TRAINING_SHARE, _MIN_STEPS = 0.4, 10
"""Share of the training's steps that the first training takes. Empirical, not calibrated."""
_RIDGE = 300.0
"""Ridge of the first model's adaptation: the lowest that `hyperparameters` tries."""
_DISTURBANCE_GAINS = replace(
    ObserverGains.none(), slow_gain=np.full(3, 0.02), slow_decay=np.full(3, 0.99)
)
"""Slow disturbance of the first model; one of those that `hyperparameters` tries."""
_GAINS = (1.0, 0.6, 0.35, 0.2)
"""Candidates for K."""
_YAW_RATE = 2
_TIE_MARGIN = 1.02
"""Factor on the smallest RMS innovation up to which gains count as equal. Empirical."""


def observer_filter(
    train: Sequence[Record],
    validation: Sequence[Record],
    settings: TrainSettings,
    on_step: Callable[[Step], None] | None = None,
    checkpoint: Path | None = None,
) -> Callable[[Record], Record]:
    """
    Return the filter of a record's yaw rate, which does nothing if that of `train` is not noisy.

    :raises DataError: as `fit`.
    """
    gain = observer_gain(train, settings.history, settings.speed_augmentation)
    if gain == 1.0:
        return _unfiltered
    first = replace(settings, steps=max(_MIN_STEPS, int(_FIRST_TRAINING_SHARE * settings.steps)))
    trained = fit(train, validation, first, on_step, checkpoint)
    built = assemble(trained, sequences(train, settings.history, 2, "training"), False)
    model = replace(
        built.model,
        online=windowed(_RIDGE),
        observer_gains=replace(_DISTURBANCE_GAINS, observer_gain=np.array([1.0, 1.0, gain])),
    )
    return partial(_filtered, model)


def _unfiltered(record: Record) -> Record:
    return record


def observer_gain(train: Sequence[Record], history: int, augment: bool = True) -> float:
    """Return the observer gain K for the yaw rate of `train`; 1 means no filtering."""
    part = sequences(train, history, 1, "training")
    scaling = scaling_of(part)
    quadratic = quadratic_features_of(part, scaling, augment)
    observer = _QuadraticObserver(quadratic, scaling, history)
    innovations = {gain: observer.rms_innovation(train, gain) for gain in _GAINS}
    least = min(innovations.values())
    return min(gain for gain, size in innovations.items() if size <= _TIE_MARGIN * least)


def _filtered(model: KoopmanModel, record: Record) -> Record:
    """Return the record with the yaw rate of the model's observer."""
    x = record.x.copy()
    x[:, _YAW_RATE] = observed_states(model, record)[:, _YAW_RATE]
    return replace(record, x=x)


class _QuadraticObserver:
    """An observer of the yaw rate that predicts with quadratic features."""

    def __init__(self, quadratic: QuadraticFeatures, scaling: Scaling, history: int) -> None:
        columns = input_columns(history)
        self._scaling, self._history = scaling, history
        self._input_bound = quadratic.reach[columns].astype(np.float64)
        # One of the three forms is needed, as a matrix.
        directions = quadratic.directions[columns].astype(np.float64)
        self._form = (directions * quadratic.weights[:, _YAW_RATE]) @ directions.T
        self._linear = quadratic.linear[columns, _YAW_RATE].astype(np.float64)
        self._level = float(quadratic.level[_YAW_RATE])
        self._past = newest(history)

    def rms_innovation(self, records: Sequence[Record], gain: float) -> float:
        """Return the RMS of the scaled innovations with an observer of this gain."""
        squares, count = 0.0, 0
        for record in records:
            innovations = self._innovations(record, gain)
            squares += float(innovations @ innovations)
            count += innovations.size
        return float(np.sqrt(squares / max(count, 1)))

    def _innovations(self, record: Record, gain: float) -> FloatArray:
        scaling, past = self._scaling, self._past
        x, u = scaling.scale_x(record.x), scaling.scale_u(record.u)
        step = float(scaling.step_scale[_YAW_RATE])
        innovations = []
        usable: BoolArray = np.asarray(np.isfinite(np.hstack([x, u])).all(axis=1))
        since = 0
        for k in range(len(record)):
            same = k > 0 and record.episode[k] == record.episode[k - 1]
            since = since + 1 if same and usable[k] else int(usable[k])
            # `past` samples are required before this one; the newest has the present command.
            if since <= past:
                continue
            row = np.concatenate(
                [
                    x[k - past : k][::-1].ravel(),
                    u[k - past : k][::-1].ravel() if self._history else [],
                ]
            )
            clamped = np.clip(row, -self._input_bound, self._input_bound)
            increment = clamped @ self._form @ clamped + row @ self._linear + self._level
            expected = x[k - 1, _YAW_RATE] + step * increment
            innovations.append(x[k, _YAW_RATE] - expected)
            x[k, _YAW_RATE] = expected + gain * innovations[-1]
        return np.array(innovations)
