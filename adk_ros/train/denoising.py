# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Training data as the car's observer will see them: the yaw rate, freed of most of its noise.

    r^_k = p_k + K (r_k - p_k)           p_k: what a first, shorter training predicts from k - 1

On the road the predictor lifts what its observer makes of a measurement, not the measurement. A
network trained on noisy yaw rates has learned to make little of their differences, and goes on
doing so where they are clean: in the observer's output, and in every step of a roll-out after the
first. K is the least gain at which the innovations of quadratic forms on the training data are as
small as at any: 1, which changes nothing, where measurements are clean or forms do not predict
them.

Only the yaw rate: what moves it, steering, is known. Speeds are moved by slopes and wind too, and
an observer of them lags behind: models trained on such speeds did worse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.evaluation import sample_at
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import Record
from adk_ros.train.assemble import assemble
from adk_ros.train.dataset import sequences
from adk_ros.train.hyperparameters import windowed
from adk_ros.train.network_fit import Step, fit, quadratic_features_of, scaling_of
from adk_ros.train.quadratic_features import QuadraticFeatures, input_columns, newest
from adk_ros.train.train_settings import TrainSettings

_SHARE, _LEAST_STEPS = 0.4, 10
"""Of the steps of the training, for the first one."""
_RIDGE = 300.0
_CORRECTION = replace(
    ObserverGains.none(), slow_gain=np.full(3, 0.02), slow_decay=np.full(3, 0.99)
)
_GAINS = (1.0, 0.6, 0.35, 0.2)
_YAW_RATE = 2
_TIE_MARGIN = 1.02
"""Times the least RMS of innovations."""


def observer_filtered(
    train: Sequence[Record],
    validation: Sequence[Record],
    settings: TrainSettings,
    on_step: Callable[[Step], None] | None = None,
    checkpoint: Path | None = None,
) -> tuple[list[Record], list[Record]]:
    """
    Return both with the yaw rate of `Record.x` as observed, if that is noisy.

    :raises DataError: as `fit`.
    """
    gain = observer_gain(train, settings.history)
    if gain == 1.0:
        return list(train), list(validation)
    first = replace(settings, steps=max(_LEAST_STEPS, int(_SHARE * settings.steps)))
    trained = fit(train, validation, first, on_step, checkpoint)
    built = assemble(trained, sequences(train, settings.history, 2, "training"), False)
    model = replace(
        built.model,
        online=windowed(_RIDGE),
        observer_gains=replace(_CORRECTION, observer_gain=np.array([1.0, 1.0, gain])),
    )
    return [_follow(model, r) for r in train], [_follow(model, r) for r in validation]


def observer_gain(train: Sequence[Record], history: int) -> float:
    """Return K, see above."""
    part = sequences(train, history, 1, "training")
    scaling = scaling_of(part)
    forms = _Forms(quadratic_features_of(part, scaling), scaling, history)
    innovations = {gain: forms.innovations(train, gain) for gain in _GAINS}
    least = min(innovations.values())
    return min(gain for gain, size in innovations.items() if size <= _TIE_MARGIN * least)


def _follow(model: KoopmanModel, record: Record) -> Record:
    """Return the record with the yaw rate that the model's observer has at each tick."""
    predictor = Predictor(model, horizon_steps=0)
    x = record.x.copy()
    for row in range(len(record)):
        if row and record.episode[row] != record.episode[row - 1]:
            predictor.reset()
        if predictor.step(sample_at(record, row)) is not None:
            x[row, _YAW_RATE] = predictor.filtered_state[_YAW_RATE]
    return replace(record, x=x)


class _Forms:
    """Quadratic forms as they predict the yaw rate, and an observer around them."""

    def __init__(self, forms: QuadraticFeatures, scaling: Scaling, history: int) -> None:
        columns = input_columns(history)
        self._scaling, self._history = scaling, history
        self._reach = forms.reach[columns].astype(np.float64)
        # One form of the three is needed, as the matrix that it is made of.
        directions = forms.directions[columns].astype(np.float64)
        self._form = (directions * forms.weights[:, _YAW_RATE]) @ directions.T
        self._linear = forms.linear[columns, _YAW_RATE].astype(np.float64)
        self._level = float(forms.level[_YAW_RATE])
        self._past = newest(history)

    def innovations(self, records: Sequence[Record], gain: float) -> float:
        """Return their RMS, scaled, with an observer of this gain."""
        squares, count = 0.0, 0
        for record in records:
            found = self._follow(record, gain)
            squares, count = squares + float(found @ found), count + found.size
        return float(np.sqrt(squares / max(count, 1)))

    def _follow(self, record: Record, gain: float) -> FloatArray:
        scaling, past = self._scaling, self._past
        x, u = scaling.scale_x(record.x), scaling.scale_u(record.u)
        step = float(scaling.step_scale[_YAW_RATE])
        innovations = []
        usable: BoolArray = np.asarray(np.isfinite(np.hstack([x, u])).all(axis=1))
        since = 0
        for k in range(len(record)):
            same = k > 0 and record.episode[k] == record.episode[k - 1]
            since = since + 1 if same and usable[k] else int(usable[k])
            # `past` samples before this one, of which the newest holds the command in force.
            if since <= past:
                continue
            row = np.concatenate(
                [
                    x[k - past : k][::-1].ravel(),
                    u[k - past : k][::-1].ravel() if self._history else [],
                ]
            )
            held = np.clip(row, -self._reach, self._reach)
            increment = held @ self._form @ held + row @ self._linear + self._level
            expected = x[k - 1, _YAW_RATE] + step * increment
            innovations.append(x[k, _YAW_RATE] - expected)
            x[k, _YAW_RATE] = expected + gain * innovations[-1]
        return np.array(innovations)
