# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How far can the model be trusted? Roll-outs of the recent past, held against what then happened.

Every ten ticks a roll-out starts from where the car then is, with the model as it then is. It goes
on by a step a tick, under the commands that really come, and is compared with each measurement.
For each step h of the horizon and each channel, over the n trials of the last 17 s or so,

    q_h = sum m y / sum m^2                       m: predicted change since the start, y: measured
    trust_h = 1 - (1 - q_h) (1 - w_h)+ n / (n + 3),          held within 0 to 1

q is the share of the predicted change that a least-squares fit keeps: 1 for a model that is right,
0 for one that tells nothing, which leaves "no change". Of what q lacks to 1 a part is put down to
chance, w = var(q) / (1 - q)^2, as James and Stein shrink a mean: a model that is right is not
distrusted for what a few trials happen to show. To m is added beforehand what the error can be
told from (see `hindsight`). The errors that remain, y - trust m, give the covariance of the
horizon, calibrated by how often the intervals given at the trials' starts held (see
`calibration`), which begins with what validation found, as if from `prior` trials.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.lifting.encoder import EncoderArrays
from adk_ros.model.lifting.encoder_kernels import pack_encoder_input
from adk_ros.model.uncertainty.compiled_rollout import fold_output_layer, rollout_step
from adk_ros.model.uncertainty.conformal import (
    ROLLOUT_STRIDE,
    ConformalScale,
    update_conformal_scale,
)
from adk_ros.model.uncertainty.error_regression import (
    N_REGRESSORS,
    ErrorRegression,
    accumulate_moments,
    predicted_error,
    solve_shrunk_regression,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import fused_kernel

_TRUST_PRIOR_COUNT = 3.0
"""Trials' worth of full trust: a few of one kind of driving tell little of the next."""
_REGRESSION_STRIDE = 2
"""Trials after which the weights of `hindsight`, which remembers hundreds, are solved for."""
_TRUST_FORGETTING = 0.985
"""A trial's weight per later trial: 67 trials, or 17 s. What is driven changes before tyres do."""


class RolloutMonitor:
    """
    Trials of one model; `trust` (h, 3) and `covariance` (h, 3, 3), scaled, are their outcome.

    `covariance` is calibrated.

    :param errors: covariance (h, 3, 3) of the scaled prediction errors on validation data.
    """

    def __init__(self, twin: EncoderArrays, errors: FloatArray, prior: float) -> None:
        n, seen = twin[0].shape[0], twin[4].shape[0]
        steps = errors.shape[0]
        self._lanes = max(1, -(-steps // ROLLOUT_STRIDE))
        self._twin = twin
        lanes = self._lanes
        self._row = np.zeros((lanes, n), np.float32)
        self._x = np.zeros((lanes, 3))
        self._base = np.zeros((lanes, 3))
        self._push = np.zeros((lanes, 2, 3))
        self._head = np.zeros((lanes, 3, seen), np.float32)
        self._short = np.zeros((lanes, 3, n), np.float32)
        self._rest = np.zeros((lanes, 3, 3))
        self._age = np.full(lanes, -1)
        self._scratch = np.zeros((2, seen + n), np.float32)
        self._sums = np.zeros((4, steps, 3))
        self._initial_disturbance = np.zeros((lanes, 3, 3))
        self._issued_forecast = np.zeros((lanes, steps, 3, 3))
        self.error_regression = ErrorRegression(steps)
        self._calibration = ConformalScale(errors, prior)
        self._arrays = self._calibration.arrays()
        self.shrinkage = np.ones((steps, 3))
        self.covariance = self._calibration.calibrated
        self.reset()

    def reset(self) -> None:
        """Forget all trials."""
        self.stop()
        self._ticks = 0
        self._sums[:] = 0.0
        self._calibration.reset()
        self.error_regression.reset()
        self.shrinkage[:] = 1.0

    def stop(self) -> None:
        """End the trials under way, after a gap; what was learned stays."""
        self._age[:] = -1

    def update(
        self,
        measured: FloatArray,
        u: FloatArray,
        usable: bool,
        n_x: int,
        step_scale: FloatArray,
        residual: bool,
        correction: FloatArray,
    ) -> None:
        """Go on by the tick that has passed under command `u` (2,), to `measured` (3,), scaled."""
        update_rollouts(
            measured,
            u,
            usable,
            n_x,
            step_scale,
            residual,
            correction,
            *self._twin[:4],
            *self._twin[7:],
            self._row,
            self._x,
            self._base,
            self._push,
            self._head,
            self._short,
            self._rest,
            self._age,
            self._scratch,
            self._sums,
            self.shrinkage,
            self._initial_disturbance,
            self._issued_forecast,
            self.error_regression.moments,
            self.error_regression.weights,
            *self._arrays,
        )

    def start(
        self,
        x_past: FloatArray,
        u_past: FloatArray,
        theta: FloatArray,
        affine: bool,
        disturbance: FloatArray,
    ) -> None:
        """Begin a trial here, if one is due."""
        self._ticks += 1
        if self._ticks % ROLLOUT_STRIDE:
            return
        lane = (self._ticks // ROLLOUT_STRIDE) % self._lanes
        w3, b3, skip = self._twin[4:7]
        start_rollout(
            x_past,
            u_past,
            theta,
            affine,
            disturbance,
            w3,
            b3,
            skip,
            self._row[lane],
            self._x[lane],
            self._base[lane],
            self._push[lane],
            self._head[lane],
            self._short[lane],
            self._rest[lane],
            lane,
            self._initial_disturbance,
            self._issued_forecast[lane],
            self.shrinkage,
            self.covariance,
            self.error_regression.weights,
        )
        self._age[lane] = 0


@fused_kernel
def start_rollout(  # type: ignore[no-untyped-def]
    x_past,
    u_past,
    theta,
    affine,
    disturbance,
    w3,
    b3,
    skip,
    row,
    x,
    base,
    push,
    head,
    short,
    rest,
    lane,
    gone,
    promised,
    trust,
    covariance,
    weights,
):
    """Fill one lane with the state, the disturbances, the model and the promises of now."""
    pack_encoder_input(x_past, u_past, row)
    fold_output_layer(theta, affine, w3, b3, skip, head, short, rest)
    x[:] = x_past[0]
    base[:] = x_past[0]
    push[:] = disturbance[:2]
    gone[lane] = disturbance
    for h in range(trust.shape[0]):
        for c in range(3):
            promised[h, 0, c] = trust[h, c]
            promised[h, 1, c] = covariance[h, c, c]
            promised[h, 2, c] = predicted_error(h, c, lane, weights, gone)


@fused_kernel
def update_rollouts(  # type: ignore[no-untyped-def]
    measured,
    u,
    usable,
    n_x,
    step_scale,
    residual,
    correction,
    w1,
    b1,
    w2,
    b2,
    columns,
    reach,
    directions,
    row,
    x,
    base,
    push,
    head,
    short,
    rest,
    age,
    scratch,
    sums,
    trust,
    gone,
    promised,
    moments,
    weights,
    count,
    covariance,
    factor,
    calibrated,
):
    """
    Advance every lane by a step and, if the measurement is `usable`, account for it.

    When the lanes began: `gone` (lanes, 3, 3), the disturbances; `promised` (lanes, steps, 3, 3)
    are trust, variances and what was foreseen of the error.
    """
    steps = trust.shape[0]
    error, surprise, factors = np.empty(3), np.empty(3), np.empty((N_REGRESSORS, N_REGRESSORS))
    for lane in range(age.shape[0]):
        if age[lane] < 0:
            continue
        rollout_step(
            row[lane],
            x[lane],
            push[lane],
            u[0],
            u[1],
            n_x,
            step_scale,
            residual,
            correction,
            w1,
            b1,
            w2,
            b2,
            columns,
            reach,
            directions,
            head[lane],
            short[lane],
            rest[lane],
            scratch[0],
            scratch[1],
        )
        h = age[lane]
        age[lane] = h + 1 if h + 1 < steps else -1
        if not usable:
            continue
        for c in range(3):
            plain, y = x[lane, c] - base[lane, c], measured[c] - base[lane, c]
            m = plain + predicted_error(h, c, lane, weights, gone)
            accumulate_moments(h, c, y - plain, lane, gone, moments)
            if lane % _REGRESSION_STRIDE == 0:
                solve_shrunk_regression(h, c, moments, factors, weights)
            sums[0, h, c] = _TRUST_FORGETTING * sums[0, h, c] + m * y
            sums[1, h, c] = _TRUST_FORGETTING * sums[1, h, c] + m * m
            sums[2, h, c] = _TRUST_FORGETTING * sums[2, h, c] + 1.0
            sums[3, h, c] = _TRUST_FORGETTING * sums[3, h, c] + y * y
            share = sums[0, h, c] / max(sums[1, h, c], 1e-12)
            lack = 1.0 - share
            left = max(sums[3, h, c] - share * sums[0, h, c], 0.0) / sums[2, h, c]
            chance = left / max(lack * lack * sums[1, h, c], 1e-12)
            weight = sums[2, h, c] / (sums[2, h, c] + _TRUST_PRIOR_COUNT) * max(1.0 - chance, 0.0)
            trust[h, c] = min(max(1.0 - weight * lack, 0.0), 1.0)
            error[c] = y - trust[h, c] * m
            promise = plain + promised[lane, h, 2, c]
            surprise[c] = y - promised[lane, h, 0, c] * promise
        update_conformal_scale(
            h, error, surprise, promised[lane, h, 1], count, covariance, factor, calibrated
        )
