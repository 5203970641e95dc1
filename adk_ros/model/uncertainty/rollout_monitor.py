# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Online validation: monitor open-loop rollouts and shrink predictions by what they reveal.

Every ten ticks a rollout starts at the present state with the present model. It advances one step
per tick under the commands actually given, and is compared with each measurement, which gives the
shrinkage k of the predicted changes m (see `shrinkage`). The error predicted from one-step
residuals (see `error_regression`) is added to m beforehand. The remaining errors, y - k m, give
the covariance of the horizon. It is scaled to 90 % coverage (see `conformal`) and starts from the
covariance found in validation, with the weight of `prior` rollouts.

Where a naive predictor takes over (see `fallback`), the error is that of the prediction which
contains it; the statistics of the model remain those of the model alone. The same comparisons
give the weight of IMU integration next to that prediction (see `shrinkage`), from the second step
on: the first one's command is known in published horizons as well, and they leave it as it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.model.estimation.observer import ScalingArrays
from adk_ros.model.lifting.encoder_kernels import EncoderArrays, pack_encoder_input
from adk_ros.model.uncertainty.compiled_rollout import (
    FoldedLayer,
    RolloutState,
    StepForm,
    fold_output_layer,
    rollout_step,
)
from adk_ros.model.uncertainty.conformal import (
    ROLLOUT_STRIDE,
    ConformalArrays,
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
from adk_ros.model.uncertainty.fallback import (
    KNOWN,
    FallbackArrays,
    integrate_imu,
    learn_weight,
    weighted_naive,
)
from adk_ros.model.uncertainty.shrinkage import update_shrinkage, update_weight
from adk_ros.numerics.array_table import (
    ArrayTable,
    floats_1,
    floats_2,
    floats_3,
    floats_4,
    integers_1,
    singles_1,
    singles_2,
    singles_3,
)
from adk_ros.numerics.arrays import Float32Array, FloatArray, IntArray
from adk_ros.numerics.numba_cache import fused_kernel, ordered_kernel

_REGRESSION_STRIDE = 2
"""Every so many rollouts the error regression, whose memory is 500 rollouts, is solved again."""


class RolloutSlots(NamedTuple):
    """
    Rollouts under way, one per slot.

    State: `row` (slots, n), `x` (slots, 3), `disturbance` (slots, 2, 3). Folded output layer:
    `w_hidden` (slots, 3, h + q), `w_skip` (slots, 3, n), `w_input_bias` (slots, 3, 3). `age`
    (slots,): next horizon step, -1 if the slot is empty. From the start: scaled state `base`
    (slots, 3), `initial_disturbance` (slots, 3, 3), and `issued` (slots, steps, 3, 3): shrinkage,
    variance and predicted error. `naive` (slots, 5, steps, 3): weight of the naive predictors and
    the change that they predict, weighted; both as trained; and the change of IMU integration.
    """

    row: Float32Array
    x: FloatArray
    disturbance: FloatArray
    w_hidden: Float32Array
    w_skip: Float32Array
    w_input_bias: FloatArray
    age: NDArray[np.int64]
    base: FloatArray
    initial_disturbance: FloatArray
    issued: FloatArray
    naive: FloatArray


class RolloutStatistics(NamedTuple):
    """
    Statistics by horizon step.

    `sums` (4, steps, 3): of m y, m^2, 1 and y^2; `shrinkage` (steps, 3): k; `moments` and
    `weights` as in `ErrorRegression`.
    """

    sums: FloatArray
    shrinkage: FloatArray
    moments: FloatArray
    weights: FloatArray


class NaiveStatistics(NamedTuple):
    """
    Of IMU integration by horizon step, as in `shrinkage`: `sums` (4, steps, 3), `weight`.

    `learns` (1,): 0 if it gets no weight but the trained one.
    """

    sums: FloatArray
    weight: FloatArray
    learns: NDArray[np.int64]


class MonitorArrays(NamedTuple):
    """All arrays of a `RolloutMonitor`; `scratch` (2, h + q + n)."""

    encoder: EncoderArrays
    slots: RolloutSlots
    statistics: RolloutStatistics
    scale: ConformalArrays
    step_scale: FloatArray
    gains: FloatArray
    bounds: FloatArray
    scratch: Float32Array
    naive: NaiveStatistics


class RolloutMonitor:
    """
    Monitored rollouts of one model.

    `shrinkage` (h, 3) and the calibrated `covariance` (h, 3, 3), scaled, are the results.

    :param form: the model's step. :param errors: covariance (h, 3, 3) of the scaled prediction
        errors on validation data. :param learns_weights: whether IMU integration gets a weight.
    """

    def __init__(
        self,
        encoder: EncoderArrays,
        form: StepForm,
        errors: FloatArray,
        prior: float,
        learns_weights: bool = True,
    ) -> None:
        n, n_hidden = encoder.w1.shape[0], encoder.w3.shape[0]
        steps = errors.shape[0]
        self._n_slots = n_slots = max(1, -(-steps // ROLLOUT_STRIDE))
        self.error_regression = ErrorRegression(steps)
        self._scale = ConformalScale(errors, prior)
        self.slots = RolloutSlots(
            row=np.zeros((n_slots, n), np.float32),
            x=np.zeros((n_slots, 3)),
            disturbance=np.zeros((n_slots, 2, 3)),
            w_hidden=np.zeros((n_slots, 3, n_hidden), np.float32),
            w_skip=np.zeros((n_slots, 3, n), np.float32),
            w_input_bias=np.zeros((n_slots, 3, 3)),
            age=np.full(n_slots, -1),
            base=np.zeros((n_slots, 3)),
            initial_disturbance=np.zeros((n_slots, 3, 3)),
            issued=np.zeros((n_slots, steps, 3, 3)),
            naive=np.zeros((n_slots, 5, steps, 3)),
        )
        self.statistics = RolloutStatistics(
            sums=np.zeros((4, steps, 3)),
            shrinkage=np.ones((steps, 3)),
            moments=self.error_regression.moments,
            weights=self.error_regression.weights,
        )
        self.naive = NaiveStatistics(
            np.zeros((4, steps, 3)), np.zeros((steps, 3)), np.array([int(learns_weights)])
        )
        self._table = ArrayTable(
            *encoder,
            *self.slots,
            *self.statistics,
            *self._scale.arrays,
            np.ascontiguousarray(form.step_scale, dtype=np.float64),
            form.gains,
            form.bounds,
            np.zeros((2, n_hidden + n), np.float32),
            *self.naive,
        )
        self.rows = self._table.rows
        """All arrays, as a table for kernels."""
        self.correction = self.statistics.weights, self.statistics.shrinkage
        """Weights of the error regression and shrinkage, as `to_si` takes them."""
        self._ticks = 0
        self.reset()

    @property
    def shrinkage(self) -> FloatArray:
        """Shrinkage k (h, 3); the array that updates change."""
        return self.statistics.shrinkage

    @property
    def covariance(self) -> FloatArray:
        """Calibrated covariance (h, 3, 3), scaled; the array that updates change."""
        return self._scale.calibrated

    def reset(self) -> None:
        """Forget all rollouts."""
        self.stop()
        self._ticks = 0
        self.statistics.sums[:] = 0.0
        self._scale.reset()
        self.error_regression.reset()
        self.shrinkage[:] = 1.0
        self.naive.sums[:] = 0.0
        self.naive.weight[:] = 0.0

    def stop(self) -> None:
        """Abort the rollouts under way, after a gap; keep the statistics."""
        self.slots.age[:] = -1

    def next_slot(self) -> int:
        """Count a tick; return the slot in which a rollout is to start here, or -1."""
        self._ticks += 1
        if self._ticks % ROLLOUT_STRIDE:
            return -1
        return int((self._ticks // ROLLOUT_STRIDE) % self._n_slots)


@fused_kernel
def monitor_arrays(rows: IntArray) -> MonitorArrays:
    """Return the structure that `RolloutMonitor` passes to kernels as a table."""
    return MonitorArrays(
        EncoderArrays(
            singles_2(rows, 0),
            singles_1(rows, 1),
            singles_2(rows, 2),
            singles_1(rows, 3),
            singles_2(rows, 4),
            singles_1(rows, 5),
            singles_2(rows, 6),
            integers_1(rows, 7),
            singles_1(rows, 8),
            singles_2(rows, 9),
            singles_1(rows, 10),
            singles_2(rows, 11),
            singles_2(rows, 12),
        ),
        RolloutSlots(
            singles_2(rows, 13),
            floats_2(rows, 14),
            floats_3(rows, 15),
            singles_3(rows, 16),
            singles_3(rows, 17),
            floats_3(rows, 18),
            integers_1(rows, 19),
            floats_2(rows, 20),
            floats_3(rows, 21),
            floats_4(rows, 22),
            floats_4(rows, 23),
        ),
        RolloutStatistics(
            floats_3(rows, 24), floats_2(rows, 25), floats_4(rows, 26), floats_3(rows, 27)
        ),
        ConformalArrays(
            floats_1(rows, 28), floats_3(rows, 29), floats_2(rows, 30), floats_3(rows, 31)
        ),
        floats_1(rows, 32),
        floats_2(rows, 33),
        floats_2(rows, 34),
        singles_2(rows, 35),
        NaiveStatistics(floats_3(rows, 36), floats_2(rows, 37), integers_1(rows, 38)),
    )


@fused_kernel
def start_rollout(
    slot: int,
    x_past: FloatArray,
    u_past: FloatArray,
    theta: FloatArray,
    affine: bool,
    disturbance: FloatArray,
    monitor: MonitorArrays,
) -> None:
    """
    Fill one slot with the present state, disturbances, model and forecast.

    `x_past`, `u_past`, `theta` as in `rollout_lifting`; `disturbance` (3, 3): slow, fast, running
    mean.
    """
    slots, statistics = monitor.slots, monitor.statistics
    folded = FoldedLayer(slots.w_hidden[slot], slots.w_skip[slot], slots.w_input_bias[slot])
    pack_encoder_input(x_past, u_past, slots.row[slot])
    fold_output_layer(theta, affine, monitor.encoder, folded)
    slots.x[slot] = x_past[0]
    slots.base[slot] = x_past[0]
    slots.disturbance[slot] = disturbance[:2]
    slots.initial_disturbance[slot] = disturbance
    slots.age[slot] = 0
    for h in range(statistics.shrinkage.shape[0]):
        for c in range(3):
            slots.issued[slot, h, 0, c] = statistics.shrinkage[h, c]
            slots.issued[slot, h, 1, c] = monitor.scale.calibrated[h, c, c]
            slots.issued[slot, h, 2, c] = predicted_error(
                h, c, slot, statistics.weights, slots.initial_disturbance
            )


@fused_kernel
def store_naive(
    slot: int, fallback: FallbackArrays, scaling: ScalingArrays, slots: RolloutSlots
) -> None:
    """Store the naive predictions of the rollout that has started in `slot`."""
    steps = slots.naive.shape[2]
    naive, trained, of_imu = np.empty((steps, 2, 3)), np.empty((steps, 2, 3)), np.empty((steps, 3))
    weighted_naive(fallback, KNOWN, False, naive)
    weighted_naive(fallback, KNOWN, True, trained)
    integrate_imu(fallback.start, of_imu)
    for h in range(steps):
        for c in range(3):
            base = slots.base[slot, c] * scaling.x_scale[c] + scaling.x_mean[c]
            unit = scaling.x_scale[c]
            slots.naive[slot, 0, h, c] = naive[h, 0, c]
            slots.naive[slot, 1, h, c] = (naive[h, 1, c] - naive[h, 0, c] * base) / unit
            slots.naive[slot, 2, h, c] = trained[h, 0, c]
            slots.naive[slot, 3, h, c] = (trained[h, 1, c] - trained[h, 0, c] * base) / unit
            slots.naive[slot, 4, h, c] = (of_imu[h, c] - base) / unit


@ordered_kernel
def update_rollouts(
    measured: FloatArray,
    u: FloatArray,
    usable: bool,
    n_x: int,
    residual: bool,
    monitor: MonitorArrays,
    fallback: FallbackArrays,
) -> None:
    """Advance every rollout by one step and, if the measurement is `usable`, account for it."""
    slots, scale = monitor.slots, monitor.scale
    sums, shrinkage, moments, weights = monitor.statistics
    form = StepForm(n_x, residual, monitor.step_scale, monitor.gains, monitor.bounds)
    steps = shrinkage.shape[0]
    error, issued_error = np.empty(3), np.empty(3)
    factors = np.empty((N_REGRESSORS, N_REGRESSORS))
    for slot in range(slots.age.shape[0]):
        if slots.age[slot] < 0:
            continue
        rollout_step(
            RolloutState(slots.row[slot], slots.x[slot], slots.disturbance[slot]),
            u[0],
            u[1],
            form,
            monitor.encoder,
            FoldedLayer(slots.w_hidden[slot], slots.w_skip[slot], slots.w_input_bias[slot]),
            monitor.scratch[0],
            monitor.scratch[1],
        )
        h = slots.age[slot]
        slots.age[slot] = h + 1 if h + 1 < steps else -1
        if not usable:
            continue
        for c in range(3):
            plain = slots.x[slot, c] - slots.base[slot, c]
            y = measured[c] - slots.base[slot, c]
            m = plain + predicted_error(h, c, slot, weights, slots.initial_disturbance)
            accumulate_moments(h, c, y - plain, slot, slots.initial_disturbance, moments)
            if slot % _REGRESSION_STRIDE == 0:
                solve_shrunk_regression(h, c, moments, factors, weights)
            # Before the shrinkage takes the error into account, which would make it smaller.
            error[c] = y - shrinkage[h, c] * m
            update_shrinkage(h, c, m, y, sums, shrinkage)
            issued_change = plain + slots.issued[slot, h, 2, c]
            issued_error[c] = y - slots.issued[slot, h, 0, c] * issued_change
            naive = slots.naive[slot, :, h, c]
            issued_error[c] += naive[0] * (y - issued_error[c]) - naive[1]
            error[c] += naive[2] * (y - error[c]) - naive[3]
            if h > 0 and monitor.naive.learns[0] != 0:
                d = naive[4] - (y - error[c])
                if np.isfinite(d):
                    of_model = error[c]
                    error[c] -= monitor.naive.weight[h, c] * d
                    update_weight(h, c, d, of_model, monitor.naive.sums, monitor.naive.weight)
                    learn_weight(h, c, monitor.naive.weight[h, c], fallback)
        update_conformal_scale(h, error, issued_error, slots.issued[slot, h, 1], scale)
